"""Trackers tuned by one protocol, and compared over all scenarios of single objects."""
