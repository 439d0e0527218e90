"""Equal trackers in each world: how often one is called better"""

# worlds.csv holds scenes of ``highway`` in each world, two runs of each. It is made by
# ``python -m benchmarks.calibration.worlds``. Nothing was fitted to them. Scenes are drawn with replacement, so that
# what is measured is said of new scenes of which the pool is the population.

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import combinations, product
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import trackbench as tb
from trackbench.base.types import Array
from trackbench.metrics.contrasts import paired
from trackbench.metrics.differences import contrast_verdict, margin_between

from .claim import Claim, power
from .differences import MARGIN, NONE
from .scenes import METRICS, rmse

POOL = Path(__file__).with_name("worlds.csv")
UNITS = {"position": "m", "velocity": "m/s"}
TRACKERS = ("raw", "kf_cv", "ekf_cv", "ekf_ca", "ukf_ctrv", "imm_cv_ca", "imm_three")
#: By world the numbers of scenes that are drawn.
SIZES = dict.fromkeys(("ideal", "human", "typical"), (5, 10, 20, 40)) | {"recorded": (5, 10)}
#: Scenes of each simulated world, those of one result, and runs of each scene.
SCENES, TOGETHER, RUNS = 100, 20, 2
#: Every so many cars of the recording one observes a scene.
CARS = 2
TRIALS = 500
#: How often an equal tracker may be called better at the default margin.
MOST = 0.05


@cache
def pool(world: str) -> dict[str, Array]:
    """Return ``(scenes,)`` number of estimates as ``count``, and by "tracker metric" the sum of squared errors."""
    with POOL.open() as file:
        rows = [row for row in csv.DictReader(file) if row["world"] == world and float(row["count"]) > 0]
    count = np.array([float(row["count"]) for row in rows])
    names = [f"{tracker} {metric}" for tracker in TRACKERS for metric in METRICS]
    return {"count": count} | {name: count * np.array([float(row[name]) for row in rows]) ** 2 for name in names}


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    for world, sizes in SIZES.items():
        for metric, size in product(METRICS, sizes):
            yield from of_size(random, world, metric, size)


def of_size(random: np.random.Generator, world: str, metric: str, size: int) -> Iterator[Claim]:
    """Yield the rates of the pair that is called better most often, with and without a margin, and the power."""
    pairs = [*combinations(TRACKERS, 2)]
    draws = random.integers(0, len(pool(world)["count"]), (TRIALS, size))
    equal = [measured(world, metric, pair, draws, equal=True) for pair in pairs]
    where = f"{world}, {size} scenes, {metric} RMSE"
    for place, (margin, most) in enumerate((("the default margin", MOST), ("no margin", 1.0))):
        shares = [float(own[place].mean()) for own in equal]
        worst = int(np.argmax(shares))
        share, names = shares[worst], " and ".join(pairs[worst])
        error = 1.96 * max(share * (1 - share), 1 / TRIALS) ** 0.5 / TRIALS**0.5
        what = f"{where}: either of two equal trackers called better at {margin}, most often of {len(pairs)} pairs"
        text = f"{100 * share:.1f} ± {100 * error:.1f} % of {TRIALS:,} ({names})"
        wanted = f"at most {100 * most:g} %" if most < 1 else "stated"
        yield Claim(what, text, wanted, share <= most, abs(share - most) > error)
    covered = min(float(own[2].mean()) for own in equal)
    yield Claim(f"{where}: interval covers, of the pair covered least", f"{100 * covered:.1f} %", "stated", True)
    real = np.mean(
        [measured(world, metric, pair, draws, equal=False)[0] for pair in pairs if "raw" not in pair], axis=0
    )
    yield power(f"{where}: the better of two filters as shipped called so at the default margin", real)


def measured(world: str, metric: str, pair: tuple[str, str], draws: Array, *, equal: bool) -> Array:
    """Return ``(3, trials)``: whether one is called better with the default margin and without, where it is not so if
    both are made ``equal``, and whether the interval covers.

    Equal trackers have the larger RMSE of the two over the pool.
    """
    table = pool(world)
    count, squares = table["count"], [table[f"{name} {metric}"] for name in pair]
    totals = [own.sum() for own in squares]
    if equal:
        squares = [own * max(totals) / total for own, total in zip(squares, totals, strict=True)]
    first, second = (float((own.sum() / count.sum()) ** 0.5) for own in squares)
    found = np.empty((3, len(draws)))
    for trial, scenes in enumerate(draws):
        a, b = (rmse(own, count, scenes) for own in squares)
        words = []
        for margin in (MARGIN, NONE):
            contrast = paired(a, b, margin_between(a, b, UNITS[metric], "smaller", margin))
            words.append(contrast_verdict(contrast, contrast.p_value, "smaller"))
        low, high = contrast.ci95 or (0.0, 0.0)
        right = {"better", "worse"} if equal else {"better" if first < second else "worse"}
        found[:, trial] = *(word in right for word in words), low <= first - second <= high
    return found


def main() -> None:
    """Write ``worlds.csv``."""
    parts = [(world, first) for world in SIZES for first in starts(world)]
    with POOL.open("w", newline="") as file, ProcessPoolExecutor(2, mp_context=get_context("spawn")) as workers:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["world", "count", *(f"{tracker} {metric}" for tracker in TRACKERS for metric in METRICS)])
        for rows in workers.map(rows_of, *zip(*parts, strict=True)):
            writer.writerows(rows)
            file.flush()


def starts(world: str) -> range:
    """Return the seed of the first scene of each result; of a recorded world the number of each observing car."""
    return range(1, SCENES + 1, TOGETHER) if world != "recorded" else range(1, 200, CARS)


def rows_of(world: str, first: int) -> list[list[str]]:
    """Return a row for each scene of a result: world, number of estimates, and root mean square errors."""
    scenes: Mapping[str, object] = {"truth.seed": first, "truth.seeds": TOGETHER}
    content = tb.load("highway", {"world": world} | ({} if world == "recorded" else scenes)).document.value
    content = {key: value for key, value in content.items() if key not in ("world", "expect")}
    if world == "recorded":
        content["truth"] = content["truth"] | {"observer": {"vehicle": [cars()[first]]}}
    runs = tb.run(tb.load(content, runs=RUNS, trackers=[*TRACKERS]), recording=False).to_pandas("runs").fillna(0.0)
    rows = []
    for _, scene in runs.groupby("scene"):
        of = dict(iter(scene.groupby("tracker")))
        count = of[TRACKERS[0]]["count"].to_numpy()
        errors = [of[tracker][column].to_numpy() for tracker in TRACKERS for column in METRICS.values()]
        means = [(count @ own**2 / max(count.sum(), 1)) ** 0.5 for own in errors]
        rows.append([world, f"{count.sum():.0f}", *(f"{error:.5g}" for error in means)])
    return rows


@cache
def cars() -> list[str]:
    """Return the names of the cars of the recording, in the order of their numbers."""
    import pandas as pd

    from trackbench.truth.formats.tables import I80_FILE

    return [str(name) for name in sorted(map(int, pd.read_parquet(I80_FILE)["id"].unique()))]


if __name__ == "__main__":
    main()
