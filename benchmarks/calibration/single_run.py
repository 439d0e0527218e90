"""Intervals of a single run"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import trackbench as tb

from .claim import Claim, rate

SEEDS = 400
SCENARIO, TRACKERS = "scripted/own_model", ("kf_lidar", "ekf")
#: The start is the same in every run, and no draw from what comes later.
SETTLED = {"score.settle_s": 1, "truth.duration_s": 21}
METRICS = ("position_rmse", "velocity_rmse", "nees")


def claims() -> Iterator[Claim]:
    """The interval of one run, from stretches of its time, covers what very many runs give."""
    results = [tb.run(tb.load(SCENARIO, SETTLED, runs=1, seed=seed, trackers=list(TRACKERS))) for seed in range(SEEDS)]
    many = tb.run(tb.load(SCENARIO, SETTLED, runs=2000, seed=SEEDS, trackers=list(TRACKERS)))
    for name in TRACKERS:
        for metric in METRICS:
            true = many[name].metrics[metric].value
            ends = np.array([result[name].metrics[metric].ci95 for result in results])
            hits = (ends[:, 0] <= true) & (true <= ends[:, 1])
            yield rate(f"{SCENARIO} {name}, one run: interval of {metric} covers", hits, 0.93, 0.97)
    better = [result.summary.differences for result in results]
    true = many[TRACKERS[0]].position_rmse.value - many[TRACKERS[1]].position_rmse.value
    found = [item.ci95 for items in better for item in items if item.metric == "position_rmse"]
    hits = [low <= true <= high for low, high in found]
    yield rate(f"{SCENARIO}, one run: interval of the difference in position covers", hits, 0.93, 0.97)
