"""Scores of what driver assistance functions decide on tracks, against what they decide on the truth."""

from trackbench.metrics.functions.table import function_metrics, functions_among, functions_at_work, published_metrics

__all__ = ["function_metrics", "functions_among", "functions_at_work", "published_metrics"]
