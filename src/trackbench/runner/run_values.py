"""The value of a metric in each single run, from the sums of a tracker."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics import Metric, evaluate
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import MetricSums
from trackbench.metrics.traffic import TRACKS, run_sums
from trackbench.results.declared import LABELLED
from trackbench.runner.tables import run_sums_record


def run_values(metric: Metric, sums: MetricSums, runs: int) -> Array | None:
    """``(runs,)`` in the unit of the metric, NaN in a run without a value; None where runs do not tell it.

    Args:
        metric: the metric.
        sums: of all runs, merged.
        runs: how many there are.
    """
    if not metric.columns:
        return None
    evaluation = evaluate(sums, np.zeros(runs, dtype=np.intp), [metric])
    if metric.columns[0] in evaluation.run_columns:
        columns = [evaluation.run_columns[name] for name in metric.columns]
    elif metric.scores == "tracks":
        columns = [*run_sums(evaluation.sums[TRACKS.name], metric.name)]
    else:
        record = run_sums_record(evaluation, sums[ESTIMATES.name], ())
        declared = {column.name: column for column in LABELLED["runs"].columns}
        columns = [np.asarray(declared[name].values(record)) for name in metric.columns]
    intervals = [metric.of_runs(*(column[run : run + 1] for column in columns)) for run in range(runs)]
    return np.array([np.nan if interval is None else interval.value for interval in intervals])
