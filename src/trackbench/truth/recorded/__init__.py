"""Truth and readings that come from a file."""
