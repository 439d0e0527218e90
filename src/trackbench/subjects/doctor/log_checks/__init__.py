"""The checks of a tracker on the recorded scans of a log, without truth."""
