"""Stepping of trackers: built-in ones in this process, others in a process of their own.

Scans and a tracker's configuration come in; checked estimates or tracks, or a tracker's fault, go out. Read
``steppers.py`` first.
"""
