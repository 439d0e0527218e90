"""Examines trackers of several objects: short scenes with known answers, each of which shows one kind of fault."""
