"""Checks of trackers of several objects; each plays a scene and names the fault that it shows."""
