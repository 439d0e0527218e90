"""What a tracker in Python computes on its way to an estimate: its values, and the lines that assign them."""
