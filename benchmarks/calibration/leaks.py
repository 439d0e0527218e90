"""Alarms for trackers that know more than they measure: how often honest ones raise them"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import trackbench as tb
from trackbench.metrics.built_in.basic import PositionOverReference
from trackbench.results.tracker_result import LEAST_OVER_BOUND

from .claim import Claim, rate

#: Runs of ``scripted/own_model`` that are cut into samples.
RUNS = 4200


def claims() -> Iterator[Claim]:
    """Filters that reach the bound are not said to beat it."""
    result = tb.run(tb.load("scripted/own_model", runs=RUNS, trackers=["kf_lidar", "ekf"]))
    table, metric = result.tables["runs"].to_pandas(), PositionOverReference()
    for name in ("kf_lidar", "ekf"):
        own = table[table.tracker == name]
        columns = np.array([own[column] for column in metric.columns])
        for runs in (2, 3, 5, 10, 100):
            samples = columns.reshape(3, -1, runs).transpose(1, 0, 2)
            intervals = [metric.of_runs(*sample) for sample in samples]
            hits = [
                item is not None and item.ci95 is not None and item.ci95[1] < LEAST_OVER_BOUND for item in intervals
            ]
            yield rate(f"scripted/own_model, {name}, {runs} runs: said to beat the bound", hits, 0.0, 0.025)
