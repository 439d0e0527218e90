"""The checks of tracks in scenes: each plays one and names the fault that it shows."""
