"""Figures of a run's report: the map of a scene, and errors over time."""
