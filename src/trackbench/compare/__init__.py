"""Finished runs held against each other, from what they left on disk."""
