"""Trackers: what a scenario names. A tracker starts a track, keeps time and runs a filter."""
