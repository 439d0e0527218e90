"""Finds the options of a tracker with which it does best: by trials on identical measurements."""
