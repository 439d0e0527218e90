"""Tables of a result, made from the blocks of its run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from trackbench.base.subjects import collected
from trackbench.base.types import Array
from trackbench.metrics import Metric, evaluate
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import MetricSums
from trackbench.metrics.traffic import TRACKS, run_sums
from trackbench.results.columns import table_of
from trackbench.runner.block import Block
from trackbench.runner.estimate_records import records_of_estimates, run_sums_record
from trackbench.runner.evaluated import Evaluated
from trackbench.runner.shared_records import FinishedRun, other_truth, road_records, truth_records
from trackbench.runner.track_records import records_of_tracks
from trackbench.runner.work import Work


def result_tables(work: Work, blocks: Sequence[Block], evaluated: Evaluated) -> dict[str, pa.Table]:
    """Return every table of a run, by name."""
    truth = work.scenes[work.recorded_scene].truth
    block = next(block for block in blocks if block.recorded_scans is not None)
    assert block.recorded_scans is not None
    recorded: dict[str, Any] = {name: item for name, item in block.recorded.items() if name in evaluated.evaluations}
    run = FinishedRun(work, blocks, evaluated, block.recorded_scans, recorded)
    records = (records_of_tracks if work.hidden else records_of_estimates)(run)
    records |= {
        "truth": truth_records(truth, work.recorded_run),
        **other_truth(work),
        "roads": road_records(truth),
        **dict(collected("records", work, evaluated, recorded)),
        **({"answers": [record for block in blocks for record in block.answers]} if work.keeps_answers else {}),
    }
    return {name: table_of(parts) for name, parts in records.items()}


def run_values(metric: Metric, sums: MetricSums, runs: int) -> Array | None:
    """Return a metric's value in each run, ``(runs,)``, NaN in a run without one; None if it has no values by run.

    Args:
        metric: the metric.
        sums: merged sums of all runs.
        runs: number of runs.
    """
    if not metric.columns:
        return None
    evaluation = evaluate(sums, np.zeros(runs, dtype=np.intp), [metric])
    if metric.columns[0] in evaluation.run_columns:
        columns = [evaluation.run_columns[name] for name in metric.columns]
    elif "tracks" in metric.needs:
        columns = [*run_sums(evaluation.sums[TRACKS.name], metric.name)]
    else:
        record = run_sums_record(evaluation, sums[ESTIMATES.name], ())
        columns = [np.asarray(record[name]) for name in metric.columns]
    intervals = [metric.of_runs(*(column[run : run + 1] for column in columns)) for run in range(runs)]
    return np.array([np.nan if interval is None else interval.value for interval in intervals])
