"""Trackers of a scenario: built-in filters with their tracks, and the options of every tracker.

A tracker's configuration and scans come in; estimates of one object, or tracks of several, go out. Read ``filtered.py``
first.
"""
