"""Correct trackers, and the same trackers with one known fault each, to test `trackbench doctor`."""
