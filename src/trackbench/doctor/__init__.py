"""Says what is wrong with a tracker."""
