"""Scenes of real traffic, drawn with replacement"""

# scenes.csv holds the scenes: shipped scenarios with other seeds, six of their trackers, two runs of each scene. It is
# made by ``python -m benchmarks.calibration.scenes``. The constants of ``trackbench.metrics.intervals`` for scenes were
# fitted to every other scene of highway, merge and intersection; what is measured here are the rest, and exit.

from __future__ import annotations

import csv
from collections.abc import Iterator
from functools import cache
from itertools import combinations, product
from pathlib import Path

import numpy as np
from scipy.special import stdtrit

import trackbench as tb
from trackbench.base.types import Array
from trackbench.metrics.contrasts import all_paired
from trackbench.metrics.intervals import Interval, ratio, root

from .claim import Claim, power, rate

POOL = Path(__file__).with_name("scenes.csv")
#: Scenes of each environment, and runs of each scene.
SCENES, RUNS = {"highway": 150, "merge": 150, "intersection": 100, "exit": 100}, 2
#: The environment of which no scene was fitted to.
HELD_BACK = "exit"
TRACKERS = ("ekf_cv", "kf_cv", "ekf_ca", "imm_cv_ca", "imm_three", "ukf_ctrv")
METRICS = {"position": "position_rmse_m", "velocity": "velocity_rmse_mps"}
#: Draws of scenes for the intervals, and for every two trackers.
TRIALS, COMPARISONS = 5000, 2000
#: Numbers of scenes.
SIZES = (5, 10, 20)
#: How much wider than Student's an interval over 20 scenes may be.
WIDEST = 1.3


@cache
def pool(environment: str) -> dict[str, Array]:
    """``(scenes,)`` number of estimates as ``count``, and by "tracker metric" the sum of their squared errors, of the
    scenes that were not fitted to and have an estimate."""
    with POOL.open() as file:
        rows = [row for row in csv.DictReader(file) if row["environment"] == environment]
    columns = {
        name: np.array([float(row[name]) for row in rows])
        for name in ("count", *(f"{tracker} {metric}" for tracker in TRACKERS for metric in METRICS))
    }
    count = columns.pop("count")
    sums = {"count": count} | {name: count * error**2 for name, error in columns.items()}
    by_scene = {name: values.reshape(-1, RUNS).sum(axis=1) for name, values in sums.items()}
    used = by_scene["count"] > 0
    if environment != HELD_BACK:
        used &= np.arange(len(used)) % 2 == 1
    return {name: values[used] for name, values in by_scene.items()}


def rmse(squares: Array, count: Array, scenes: Array) -> Interval:
    """Of some scenes, as a result has it."""
    return root(ratio(squares[scenes], count[scenes], at_least=0.0, scenes=True))


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    for environment, metric, size in product(SCENES, METRICS, SIZES):
        yield from covers(random, environment, metric, size)
    for environment, metric, size in product(SCENES, METRICS, SIZES):
        yield from better(random, environment, metric, size)


def covers(
    random: np.random.Generator, environment: str, metric: str, size: int, trials: int = TRIALS
) -> Iterator[Claim]:
    """The claims of one number of scenes, over all trackers and of those that are covered least and most."""
    where = f"{environment}, {size} scenes, {metric} RMSE"
    inside, widths = coverage(random, environment, metric, size, trials)
    yield rate(f"{where}: interval covers, mean over {len(TRACKERS)} trackers", inside.mean(axis=1), 0.93, 0.97)
    least, most = int(inside.mean(axis=0).argmin()), int(inside.mean(axis=0).argmax())
    yield rate(f"{where}: the same of the tracker covered least", inside[:, least], 0.93, 1.0)
    claim = rate(f"{where}: the same of the tracker covered most", inside[:, most], 0.0, 1.0)
    yield claim._replace(wanted="stated")
    if size == max(SIZES):
        wide = float(widths.mean())
        what = f"{where}: width over that of Student's interval"
        yield Claim(what, f"{wide:.2f}", f"at most {WIDEST:g}", wide <= WIDEST, excess=wide - WIDEST)


def coverage(
    random: np.random.Generator, environment: str, metric: str, size: int, trials: int = TRIALS
) -> tuple[Array, Array]:
    """``(trials, trackers)`` whether the interval covers the value of all scenes; ``(trackers,)`` mean width over
    Student's."""
    table = pool(environment)
    count = table["count"]
    inside, widths = np.empty((trials, len(TRACKERS))), np.zeros((2, len(TRACKERS)))
    for trial, scenes in enumerate(random.integers(0, len(count), (trials, size))):
        for column, tracker in enumerate(TRACKERS):
            squares = table[f"{tracker} {metric}"]
            interval = rmse(squares, count, scenes)
            assert interval.ci95 is not None
            assert interval.error is not None
            low, high = interval.ci95
            inside[trial, column] = low <= np.sqrt(squares.sum() / count.sum()) <= high
            widths[:, column] += high - low, 2 * stdtrit(size - 1, 0.975) * interval.error
    return inside, widths[0] / widths[1]


def better(
    random: np.random.Generator, environment: str, metric: str, size: int, trials: int = COMPARISONS
) -> Iterator[Claim]:
    """Of every two trackers whether one is called better, without a margin: scaled to the same error over all scenes,
    where it is wrong; and as they are, where they differ by a tenth or more."""
    table = pool(environment)
    errors = np.array([table[f"{tracker} {metric}"].sum() for tracker in TRACKERS]) ** 0.5
    wrong = called_better(random, environment, metric, size, errors, trials).mean(axis=0)
    first, second = np.unravel_index(wrong.argmax(), wrong.shape)
    where = f"{environment}, {size} scenes, {metric} RMSE"
    what = f"{where}: called better than its equal, most often of {wrong.size - len(TRACKERS)} pairs"
    share = float(wrong.max())
    pair = f"{TRACKERS[first]} than {TRACKERS[second]}"
    measured = f"{100 * share:.1f} % of {trials:,} ({pair})"
    yield Claim(what, measured, "at most 3.5 %", share <= 0.035, excess=share - 0.035)
    shown = called_better(random, environment, metric, size, np.ones(len(TRACKERS)), trials)
    apart = errors[:, None] <= 0.9 * errors
    yield power(
        f"{where}: called better than one that is worse by a tenth or more, of {apart.sum()}",
        shown[:, apart].mean(axis=1),
    )


def called_better(
    random: np.random.Generator, environment: str, metric: str, size: int, errors: Array, trials: int = COMPARISONS
) -> Array:
    """``(trials, trackers, trackers)`` whether the first is called better than the second, over their ``errors``."""
    table = pool(environment)
    pairs = [*combinations(range(len(TRACKERS)), 2)]
    verdicts = np.zeros((trials, len(TRACKERS), len(TRACKERS)), dtype=bool)
    for trial, scenes in enumerate(random.integers(0, len(table["count"]), (trials, size))):
        intervals = [
            rmse(table[f"{tracker} {metric}"] / error**2, table["count"], scenes)
            for tracker, error in zip(TRACKERS, errors, strict=True)
        ]
        for (first, second), contrast in zip(pairs, all_paired(intervals, pairs, lambda *_: 0.0), strict=True):
            low, high = contrast.ci95 or (0.0, 0.0)
            verdicts[trial, first, second], verdicts[trial, second, first] = high < 0.0, low > 0.0
    return verdicts


def main() -> None:
    """Write ``scenes.csv``."""
    names = [f"{tracker} {metric}" for tracker in TRACKERS for metric in METRICS]
    with POOL.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["environment", "count", *names])
        for environment in SCENES:
            scenario = tb.load(environment, {"truth.seeds": SCENES[environment]}, runs=RUNS, trackers=[*TRACKERS])
            runs = tb.run(scenario).to_pandas("runs").set_index("tracker")
            columns = [runs.loc[tracker, column] for tracker in TRACKERS for column in METRICS.values()]
            for count, *errors in zip(runs.loc[TRACKERS[0], "count"], *columns, strict=True):
                # Where a run has no estimate there is no error.
                writer.writerow([environment, f"{count:.0f}", *(f"{np.nan_to_num(error):.4g}" for error in errors)])
            file.flush()


if __name__ == "__main__":
    main()
