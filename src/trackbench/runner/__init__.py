"""A scenario times trackers times runs."""
