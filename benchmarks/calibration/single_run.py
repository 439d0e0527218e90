"""Intervals of a single run, and limits on a log"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import trackbench as tb
from trackbench.metrics import Metric
from trackbench.metrics.built_in.basic import Coverage
from trackbench.metrics.contrasts import Contrast, paired
from trackbench.metrics.differences import contrast_verdict
from trackbench.metrics.intervals import FEWEST_STRETCHES, Interval, ratio, root
from trackbench.metrics.protocol import Chunk, Scope
from trackbench.metrics.sums import ERROR, stretch_numbers
from trackbench.runner.loop import run_block
from trackbench.runner.recorded import Outcome
from trackbench.runner.work import BlockRuns, work_of
from trackbench.scenario.truth import truths_of

from .claim import Claim, power, rate

SCENARIO = "scripted/own_model"
#: Runs that say what is true.
MANY = 800
#: Duration of a log, two, four, five, six and twenty stretches of time, and how many such single runs are looked at.
RUNS = {9: 3000, 17: 1500, 21: 1500, 25: 1500, 81: 600}
METRICS = {"position_rmse": ("px", "py"), "velocity_rmse": ("vx", "vy"), "nees": ("nees",)}
#: Process noise of a version of a tracker, and some with about as large an error: too little noise, and too much.
KEY, LOW, HIGH = "trackers.ekf.acceleration_sigma_mps2", 1.0, (5.0, 7.0)
#: That of a version with a much larger error.
FAR = 200.0
#: A second lidar, and a tracker that reads it alone: its errors have the law of those of ``kf_lidar``.
TWIN: dict[str, Any] = {
    "sensors.second": {"type": "lidar", "rate_hz": 20, "position_sigma_m": 0.15},
    "trackers.twin": {
        "motion": "cv",
        "acceleration_sigma_mps2": 2,
        "filter": "kf",
        "sensors": ["second"],
        "advance_at": "all_scans",
        "initial": {"from": "truth", "position_sigma_m": 1, "velocity_sigma_mps": 5},
    },
}
Sums = np.ndarray[Any, np.dtype[np.float64]]


def claims() -> Iterator[Claim]:
    """Intervals over stretches of time cover what very many runs give; of two versions of a tracker that are equally
    good on such logs neither is called better on one."""
    for seconds, runs in RUNS.items():
        where = f"{SCENARIO}, one run of {seconds} s"
        for tracker in ("kf_lidar", "ekf"):
            single, many = _sums(seconds, tracker, runs, 0), _sums(seconds, tracker, MANY, 1)
            for metric in METRICS:
                true = _interval(many, metric, slice(None)).value
                ends = [_interval(single, metric, run).ci95 for run in range(runs)]
                hits = [low <= true <= high for low, high in ends]
                yield rate(f"{where}, {tracker}: interval of {metric} covers", hits, 0.93, 0.97)
        if seconds >= 4 * FEWEST_STRETCHES:
            yield from _versions(seconds, runs, where)


def _versions(seconds: int, runs: int, where: str) -> Iterator[Claim]:
    """Two versions with the same error over very many runs, held against each other on single runs."""
    errors = {q: _error(_sums(seconds, "ekf", MANY, 1, q)) for q in (LOW, *HIGH)}
    equal = float(np.exp(np.interp(errors[LOW], [errors[q] for q in HIGH], np.log(HIGH))))
    a, b = (_sums(seconds, "ekf", runs, 0, q) for q in (LOW, equal))
    far = _sums(seconds, "ekf", runs, 0, FAR)
    true = errors[LOW] - _error(_sums(seconds, "ekf", MANY, 1, equal))
    true_far = errors[LOW] - _error(_sums(seconds, "ekf", MANY, 1, FAR))
    yield from _words(f"{where}: of two equal versions", _pairs(a, b))
    # The ratio varies by what both errors do, of which a large difference has the larger one alone: too wide is safe.
    for what, other, difference, most in (("two versions", b, true, 0.97), ("versions far apart", far, true_far, 1.0)):
        ends = [pair.ci95 for pair in _pairs(a, other)]
        hits = [interval is not None and interval[0] <= difference <= interval[1] for interval in ends]
        yield rate(f"{where}: interval of the difference of {what} covers", hits, 0.93, most)
    better = [_word(pair) == "better" for pair in _pairs(a, far)]
    yield power(f"{where}: of versions far apart, {-true_far:.2f} m, the first is called better", better)
    twins = [_sums(seconds, name, runs, 0, twin=True) for name in ("kf_lidar", "twin")]
    yield from _words(f"{where}: of two trackers whose errors have one law", _pairs(*twins))


def _pairs(a: Sums, b: Sums) -> list[Contrast]:
    """The difference of two trackers on each single run."""
    runs = range(a.shape[-1])
    sides = ([_interval(side, "position_rmse", run)._replace(of_stretches=True) for run in runs] for side in (a, b))
    return [paired(*both) for both in zip(*sides, strict=True)]


def _word(pair: Contrast) -> str:
    return contrast_verdict(pair, pair.p_value, "smaller")


def _words(where: str, pairs: Sequence[Contrast]) -> Iterator[Claim]:
    words = [_word(pair) for pair in pairs]
    for word in ("better", "worse"):
        yield rate(f"{where} the first is called {word}", [each == word for each in words], 0.0, 0.05)
    yield rate(f"{where} one is called better", [each in ("better", "worse") for each in words], 0.0, 0.05)


class StretchSums(Metric):
    """Of many runs at once the sums in each stretch of time, as of each run by itself."""

    name = "stretch_sums"
    unit = "1"
    meaning = "sums of the errors in each stretch of time of each run"

    def init(self, scope: Scope) -> dict[str, Any]:
        time = scope.labelled.time
        stretch = stretch_numbers(len(time), float(time[-1] - time[0]))
        return {"stretch": stretch, "sums": np.zeros((len(ERROR), stretch[-1] + 1, scope.runs)), "runs": scope.runs}

    def update(self, sums: dict[str, Any], chunk: Chunk) -> dict[str, Any]:
        values = np.where(chunk.scored, chunk.values, 0.0)
        by_run = values.reshape(*values.shape[:2], -1, sums["runs"]).sum(axis=2)
        for number, instant in enumerate(range(len(sums["stretch"]))[chunk.instants]):
            sums["sums"][:, sums["stretch"][instant]] += by_run[:, number]
        return sums

    def finish(self, sums: dict[str, Any]) -> None:
        """It is read as it is."""


def _sums(seconds: int, tracker: str, runs: int, seed: int, q: float | None = None, twin: bool = False) -> Sums:
    """``(17, stretches, runs)`` sums of a tracker's errors, rows ``ERROR_FIELDS``."""
    # The start is the same in every run, and no draw from what comes later.
    changes = {
        "score.settle_s": 1,
        "truth.duration_s": seconds,
        **({} if q is None else {KEY: q}),
        **(TWIN if twin else {}),
    }
    loaded = tb.load(SCENARIO, changes, runs=runs, seed=seed, trackers=[tracker])
    work = replace(work_of(loaded, truths_of(loaded)), metrics=(Coverage(), StretchSums()))
    outcome = run_block(work, BlockRuns(0, range(runs))).outcomes[tracker]
    assert isinstance(outcome, Outcome)
    sums: Sums = outcome.sums[StretchSums.name]["sums"]
    return sums


def _interval(sums: Sums, metric: str, run: slice | int) -> Interval:
    """A metric of one run or of some, from its stretches."""
    rows, count = METRICS[metric], "given" if metric == "nees" else "count"
    total, number = sum(sums[ERROR[row], :, run] for row in rows), sums[ERROR[count], :, run]
    mean = ratio(np.ravel(total), np.ravel(number), at_least=0.0)
    return mean if metric == "nees" else root(mean)


def _error(sums: Sums) -> float:
    return _interval(sums, "position_rmse", slice(None)).value
