"""The commands that show a recording."""
