"""Equal trackers in each world: how often one is called better"""

# worlds.csv holds scenes of ``highway`` in each world, two runs of each. It is made by
# ``python -m benchmarks.calibration.worlds``. Nothing was fitted to them, but that three such pools
# of ``typical``, this among them, said how much larger an error must be there. Scenes are drawn with replacement, so
# that what is measured is said of new scenes of which the pool is the population.

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
from trackbench.metrics.contrasts import all_paired
from trackbench.metrics.differences import contrast_verdict, margin_between

from .claim import STATED, Claim, power
from .differences import MARGIN, NONE
from .scenes import METRICS, rmse

POOL = Path(__file__).with_name("worlds.csv")
UNITS = {"position": "m", "velocity": "m/s"}
TRACKERS = ("raw", "kf_cv", "ekf_cv", "ekf_ca", "ukf_ctrv", "imm_cv_ca", "imm_three")
#: By world the numbers of scenes that are drawn.
SIZES = dict.fromkeys(("ideal", "human", "typical"), (5, 10, 20, 40)) | {"recorded": (5, 10)}
#: Seed of the first scene of each simulated world, scenes of each, those of one result, and runs of each scene.
FIRST, SCENES, TOGETHER, RUNS = 1001, 100, 20, 2
#: Every so many cars of the recording one observes a scene.
CARS = 2
TRIALS = 2000
PAIRS = [*combinations(TRACKERS, 2)]
MARGINS = {"the default margin": MARGIN, "no margin": NONE}
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
    draws = random.integers(0, len(pool(world)["count"]), (TRIALS, size))
    words, covered = verdicts(world, metric, draws, equal=True)
    where = f"{world}, {size} scenes, {metric} RMSE"
    for margin, most in ("the default margin", MOST), ("no margin", 1.0):
        shares = np.isin(words[margin], ("better", "worse")).mean(axis=0)
        worst = int(shares.argmax())
        share, names = float(shares[worst]), " and ".join(PAIRS[worst])
        error = 1.96 * max(share * (1 - share), 1 / TRIALS) ** 0.5 / TRIALS**0.5
        what = f"{where}: either of two equal trackers called better at {margin}, most often of {len(PAIRS)} pairs"
        text = f"{100 * share:.1f} ± {100 * error:.1f} % of {TRIALS:,} ({names})"
        wanted = f"at most {100 * most:g} %" if most < 1 else STATED
        yield Claim(what, text, wanted, share <= most, abs(share - most) > error, share - most)
    least = f"{100 * covered.mean(axis=0).min():.1f} %"
    yield Claim(f"{where}: interval of the difference covers, of the pair covered least", least, STATED, True)
    yield from shown(world, metric, draws, where)


def shown(world: str, metric: str, draws: Array, where: str) -> Iterator[Claim]:
    """Yield how often the better of two filters, as they are shipped, is called better at the default margin."""
    errors = rmses(world, metric)
    right = np.array(["better" if errors[a] < errors[b] else "worse" for a, b in PAIRS])
    words, _ = verdicts(world, metric, draws, equal=False)
    filters = np.array(["raw" not in pair for pair in PAIRS])
    apart = filters & np.array([min(errors[a], errors[b]) <= 0.9 * max(errors[a], errors[b]) for a, b in PAIRS])
    for kind, chosen in ("two filters", filters), ("two filters a tenth or more apart", apart):
        if chosen.any():
            hits = (words["the default margin"] == right)[:, chosen].mean(axis=1)
            yield power(f"{where}: the better of {kind} called so at the default margin, of {chosen.sum()} pairs", hits)


def rmses(world: str, metric: str) -> dict[str, float]:
    """Return the error of each tracker over the pool."""
    table = pool(world)
    return {name: float((table[f"{name} {metric}"].sum() / table["count"].sum()) ** 0.5) for name in TRACKERS}


def verdicts(world: str, metric: str, draws: Array, *, equal: bool) -> tuple[dict[str, Array], Array]:
    """Return by margin ``(trials, pairs)`` the verdict on the first of each pair, and whether its interval covers.

    Args:
        world: of the pool.
        metric: that is compared.
        draws: ``(trials, size)`` numbers of the scenes that are drawn.
        equal: whether the errors of each tracker are scaled to those of the worst filter over the pool, where an
            absolute margin protects least.
    """
    table, errors = pool(world), rmses(world, metric)
    worst = max(error for name, error in errors.items() if name != "raw")
    factors = {name: worst / error if equal else 1.0 for name, error in errors.items()}
    squares = {name: table[f"{name} {metric}"] * factors[name] ** 2 for name in TRACKERS}
    places = [(TRACKERS.index(a), TRACKERS.index(b)) for a, b in PAIRS]
    values = [factors[a] * errors[a] - factors[b] * errors[b] for a, b in PAIRS]
    words: dict[str, list[list[str]]] = {name: [] for name in MARGINS}
    covered = []
    for scenes in draws:
        intervals = [rmse(squares[name], table["count"], scenes) for name in TRACKERS]
        intervals = [interval._replace(few_decide=world == "typical") for interval in intervals]
        for name, margin in MARGINS.items():
            contrasts = all_paired(
                intervals,
                places,
                lambda a, b, margin=margin: margin_between(a, b, UNITS[metric], "smaller", margin),
            )
            words[name].append([contrast_verdict(own, own.p_value, "smaller") for own in contrasts])
        ends = [own.ci95 or (0.0, 0.0) for own in contrasts]
        covered.append([low <= value <= high for (low, high), value in zip(ends, values, strict=True)])
    return {name: np.array(own) for name, own in words.items()}, np.array(covered)


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
    return range(FIRST, FIRST + SCENES, TOGETHER) if world != "recorded" else range(FIRST % CARS, 200, CARS)


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
