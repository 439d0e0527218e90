"""Finished results held against each other: trackers of a run, versions of a tracker, trackers over scenarios."""

from trackbench.compare.assembly import compare
from trackbench.compare.comparison import Comparison, Entrant, PairDifference, load
from trackbench.compare.entries import ResultSet, find, results_in
from trackbench.compare.limits import Limit

__all__ = ["Comparison", "Entrant", "Limit", "PairDifference", "ResultSet", "compare", "find", "load", "results_in"]
