"""Comparison of finished results: trackers of a run, versions of a tracker, trackers over scenarios.

Sets of results (a set: one result for each scenario, of one version of the trackers) come in. A ``Comparison`` goes
out: paired differences, an order of trackers and the outcome of limits. Read ``assembly.py`` first.
"""

from trackbench.compare.assembly import compare_results
from trackbench.compare.comparison import Comparison, Entrant, PairDifference, load_comparison
from trackbench.compare.entries import ResultSet, find_results, find_sets, results_in
from trackbench.compare.limits import Limit

__all__ = [
    "Comparison",
    "Entrant",
    "Limit",
    "PairDifference",
    "ResultSet",
    "compare_results",
    "find_results",
    "find_sets",
    "load_comparison",
    "results_in",
]
