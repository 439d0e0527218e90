"""Scenes of real traffic, drawn with replacement"""

# scenes.csv holds the scenes: shipped scenarios with other seeds, six of their trackers, two runs of each scene. It is
# made by ``python -m benchmarks.calibration.scenes``, which simulates for an hour. The constants of
# ``trackbench.metrics.intervals.Parts`` were fitted to highway and merge. Intersection was looked at
# with each of three such rules, exit once, with the last.

from __future__ import annotations

import csv
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

import trackbench as tb
from trackbench.base.distributions import t_quantile
from trackbench.base.types import Array
from trackbench.metrics.intervals import Interval, paired, ratio, root

from .claim import Claim, rate

POOL = Path(__file__).with_name("scenes.csv")
HELD_BACK = ("intersection", "exit")
#: Scenes of each environment, and runs of each scene.
SCENES, RUNS = {"highway": 150, "merge": 150, "intersection": 100, "exit": 100}, 2
TRACKERS = ("ekf_cv", "kf_cv", "ekf_ca", "imm_cv_ca", "imm_three", "ukf_ctrv")
METRICS = {"position": "position_rmse_m", "velocity": "velocity_rmse_mps"}
TRIALS = 2000
#: Numbers of scenes.
SIZES = (5, 10, 20)
#: How much wider than Student's an interval over 20 scenes may be.
WIDEST = 1.3


@cache
def pool(environment: str) -> dict[str, Array]:
    """``(scenes, RUNS)`` number of estimates as ``count``, and by "tracker metric" the sum of their squared errors."""
    with POOL.open() as file:
        rows = [row for row in csv.DictReader(file) if row["environment"] == environment]
    count = np.array([float(row["count"]) for row in rows]).reshape(-1, RUNS)
    errors = {
        f"{tracker} {metric}": np.array([float(row[f"{tracker} {metric}"]) for row in rows]).reshape(-1, RUNS)
        for tracker in TRACKERS
        for metric in METRICS
    }
    return {"count": count} | {name: count * error**2 for name, error in errors.items()}


def drawn(random: np.random.Generator, count: Array, size: int, trials: int) -> Iterator[Array]:
    """``(size,)`` numbers of scenes that have an estimate, for each trial."""
    seen = np.flatnonzero(count.sum(axis=1))
    yield from random.choice(seen, (trials, size))


def rmse(squares: Array, count: Array, scenes: Array) -> Interval:
    """Of some scenes, with all their runs, as a result has it."""
    return root(ratio(squares[scenes].sum(axis=1), count[scenes].sum(axis=1), scenes=True))


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    for environment in SCENES:
        for metric in METRICS:
            for size in SIZES:
                yield from covers(random, environment, metric, size)
    for environment in SCENES:
        for metric in METRICS:
            for tracker in ("imm_cv_ca", "imm_three"):
                for size in SIZES:
                    wrong = falsely_better(random, environment, f"{tracker} {metric}", f"ekf_cv {metric}", size)
                    what = f"{environment}, {size} scenes, {metric}: {tracker} better than ekf_cv, which is its equal"
                    yield rate(what, wrong, 0.0, 0.035)


def covers(
    random: np.random.Generator, environment: str, metric: str, size: int, trials: int = TRIALS
) -> Iterator[Claim]:
    """The claims of one number of scenes, over all trackers and of that which is covered least."""
    held = " (not fitted to)" if environment in HELD_BACK else ""
    where = f"{environment}{held}, {size} scenes, {metric} RMSE"
    inside, widths = coverage(random, environment, metric, size, trials)
    yield rate(f"{where}: interval covers, mean over {len(TRACKERS)} trackers", inside.mean(axis=1), 0.93, 0.97)
    least = int(inside.mean(axis=0).argmin())
    yield rate(f"{where}: the same of {TRACKERS[least]}, covered least", inside[:, least], 0.93, 0.97)
    if size == max(SIZES):
        wide = float(widths.mean())
        what = f"{where}: width over that of Student's interval"
        yield Claim(what, f"{wide:.2f}", f"at most {WIDEST:g}", wide <= WIDEST)


def coverage(
    random: np.random.Generator, environment: str, metric: str, size: int, trials: int = TRIALS
) -> tuple[Array, Array]:
    """``(trials, trackers)`` whether the interval covers the value of all scenes; ``(trackers,)`` mean width over
    Student's."""
    table = pool(environment)
    count = table["count"]
    inside, widths = np.empty((trials, len(TRACKERS))), np.zeros((2, len(TRACKERS)))
    for column, tracker in enumerate(TRACKERS):
        squares = table[f"{tracker} {metric}"]
        expected = np.sqrt(squares.sum() / count.sum())
        for trial, scenes in enumerate(drawn(random, count, size, trials)):
            interval = rmse(squares, count, scenes)
            assert interval.ci95 is not None
            assert interval.error is not None
            low, high = interval.ci95
            inside[trial, column] = low <= expected <= high
            widths[:, column] += high - low, 2 * t_quantile(0.975, size - 1) * interval.error
    return inside, widths[0] / widths[1]


def falsely_better(
    random: np.random.Generator, environment: str, tracker: str, against: str, size: int, trials: int = TRIALS
) -> list[bool]:
    """Whether a tracker is shown to be better than another, of which all scenes have the same error after scaling."""
    table = pool(environment)
    count, own, other = table["count"], table[tracker], table[against]
    own = own * (other.sum() / own.sum())
    wrong = []
    for scenes in drawn(random, count, size, trials):
        ci95 = paired(rmse(own, count, scenes), rmse(other, count, scenes)).ci95
        wrong.append(ci95 is not None and ci95[1] < 0.0)
    return wrong


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
