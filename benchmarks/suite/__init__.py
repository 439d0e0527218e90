"""Trackers of FilterPy and Stone Soup that enter the suite, and what makes the entries of results/suite."""
