"""Figures of a run's report, drawn when a renderer needs them."""
