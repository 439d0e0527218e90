"""Values that a tracker in Python computes on its way to an estimate, and the lines that assign them."""
