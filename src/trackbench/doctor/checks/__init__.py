"""The parts of an examination: each asks one question of a tracker, and names the faults that answer it."""
