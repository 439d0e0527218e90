"""Correct trackers, and the same trackers with one known fault each: what `trackbench doctor` is measured on."""
