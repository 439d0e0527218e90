"""Examines a tracker and names its faults."""
