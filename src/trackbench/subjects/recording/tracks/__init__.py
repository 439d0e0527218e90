"""The recording of a run whose identities are hidden: tracks, what they were taken for, and what happened."""
