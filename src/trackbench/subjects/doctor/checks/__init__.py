"""The checks of an examination: each looks for one family of faults."""
