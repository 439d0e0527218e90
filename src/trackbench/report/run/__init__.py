"""The report of a run with known identities."""
