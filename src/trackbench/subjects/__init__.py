"""The subjects: each package is one task beside a run, complete, and independent of all other subjects."""
