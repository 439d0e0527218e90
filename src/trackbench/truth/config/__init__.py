"""Options of the built-in sources of truth."""
