"""Intervals of one tracker, and of paired differences"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import trackbench as tb
from trackbench.metrics.contrasts import paired
from trackbench.metrics.intervals import Interval, clustered, ratio, root

from .claim import Claim, rate

TRIALS = 4000
#: Runs of the motorway that stand for all runs, from which the samples are drawn.
POPULATION = 4000
#: What a 95 % interval may cover.
LOW, HIGH = 0.93, 0.97

Draw = Callable[[np.random.Generator, int], np.ndarray]
#: Squared errors of a run, with the mean 1: their coefficient of variation is .1, .71 and .53.
SHAPES: dict[str, Draw] = {
    "chi-square, 200 degrees of freedom": lambda random, runs: random.chisquare(200, runs) / 200,
    "chi-square, 4 degrees of freedom": lambda random, runs: random.chisquare(4, runs) / 4,
    "lognormal, sigma 0.5": lambda random, runs: random.lognormal(-0.125, 0.5, runs),
}


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    for name, draw in SHAPES.items():
        for runs in (5, 10, 50, 400):
            inside = [_covers(_rmse(draw(random, runs)), 1.0) for _ in range(TRIALS)]
            yield rate(f"RMSE, squared errors {name}, {runs} runs: interval covers", inside, LOW, HIGH)
    yield from _scenes(random)
    yield from _motorway(random)
    yield from _rare(random)


def _rmse(squares: np.ndarray) -> Interval:
    return root(ratio(squares, np.ones(len(squares))))


def _covers(found: Interval, value: float) -> bool:
    assert found.ci95 is not None
    return found.ci95[0] <= value <= found.ci95[1]


def _scenes(random: np.random.Generator) -> Iterator[Claim]:
    """Half of the variance of the logarithm is the scene's; scenes have different numbers of runs."""
    for scenes in (5, 10, 20):
        inside = []
        for _ in range(TRIALS):
            scene = np.repeat(np.arange(scenes), random.integers(5, 16, scenes))
            logs = 0.35 * random.normal(size=scenes)[scene] + 0.35 * random.normal(size=len(scene)) - 0.35**2
            found = clustered(_rmse(np.exp(logs)), scene)
            inside.append(_covers(found, 1.0))
        yield rate(f"RMSE, {scenes} scenes of 5 to 15 runs, clustered: interval covers", inside, LOW, HIGH)


def _motorway(random: np.random.Generator) -> Iterator[Claim]:
    """Samples of the runs of the shipped motorway, whose EKF never diverges."""
    result = tb.run(tb.load("highway", runs=POPULATION, trackers=["ekf_cv", "kf_cv"]))
    table = result.to_pandas("runs").set_index("tracker")
    ekf, kf = (table.loc[name] for name in ("ekf_cv", "kf_cv"))
    count = ekf["count"].to_numpy()
    columns = {"position RMSE": "position_rmse_m", "velocity RMSE": "velocity_rmse_mps", "NEES": "nees_mean"}
    for what, column in columns.items():
        values = [frame[column].to_numpy() ** (1 if column == "nees_mean" else 2) * count for frame in (ekf, kf)]

        def of(runs: np.ndarray | slice, total: np.ndarray, square: bool = column != "nees_mean") -> Interval:
            found = ratio(total[runs], count[runs], at_least=0.0)
            return root(found) if square else found

        truth = [of(slice(None), total).value for total in values]
        for size in (5, 10, 50, 400):
            inside, differs = [], []
            for _ in range(TRIALS):
                runs = random.integers(0, POPULATION, size)
                own, other = (of(runs, total) for total in values)
                inside.append(_covers(own, truth[0]))
                low, high = paired(own, other).ci95 or (0.0, 0.0)
                differs.append(low <= truth[0] - truth[1] <= high)
            yield rate(f"motorway, {what} of the EKF, {size} runs: interval covers", inside, LOW, HIGH)
            what_differs = f"motorway, {what} of the EKF minus that of the KF, {size} runs: interval covers"
            yield rate(what_differs, differs, LOW, HIGH)


def _rare(random: np.random.Generator) -> Iterator[Claim]:
    """Where it stops: what no run shows."""
    share, size = 0.005, 50
    mean = 1 + share * 999
    missed = []
    for _ in range(TRIALS):
        squares = random.chisquare(200, size) / 200 * np.where(random.random(size) < share, 1000.0, 1.0)
        missed.append(not _covers(_rmse(squares), np.sqrt(mean)))
    what = (
        "one run in 200 diverges, squared error 1000 times: 50 runs see none in 78 % of cases, and the interval misses"
    )
    yield rate(what, missed, 0.75, 0.85)
