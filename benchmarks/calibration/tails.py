"""Tails of the NEES, and errors along and across the motion"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from trackbench.base.types import Array, Estimate
from trackbench.metrics import Scorer, Target
from trackbench.metrics.built_in.basic import Nees
from trackbench.metrics.conditions import AGES, MANOEUVRES, SHAPE, Classes
from trackbench.metrics.consistency import BEYOND, beyond_points
from trackbench.metrics.evaluate import MetricSums, evaluate, merge_sums
from trackbench.results import MetricValue

from .claim import Claim, rate

INSTANTS, OBJECTS, DT = 400, 5, 0.05
#: Instants of each manoeuvre, in three stretches of each.
SHARES = (0.6, 0.2, 0.1, 0.07, 0.03)
#: Range band of each object.
BANDS = (0, 0, 1, 2, 3)

Filter = Callable[[Array], tuple[Array, Array]]
"""Of whitened errors ``(4, instants, objects, runs)`` the errors, and the variances that the filter states."""


def matched(errors: Array) -> tuple[Array, Array]:
    """A filter whose errors are as large as it states."""
    return errors, np.ones(errors.shape[1])


def alternating(errors: Array) -> tuple[Array, Array]:
    """The covariance times 40 and .51 in turn: a mean NEES of 3.97."""
    return errors, np.where(np.arange(errors.shape[1]) % 2, 0.51, 40.0)


def beyond(errors: Array) -> tuple[Array, Array]:
    """A tenth of the NEES beyond their 95 % point, and a mean of 4.01: those of the largest twentieth to tenth are
    made so large, and all others smaller."""
    nees = (errors**2).sum(axis=0)
    near, tenth = beyond_points(4)[0], 7.779440339734858
    inner = np.where(nees > tenth, 1.0, np.sqrt(0.985))
    return errors * np.where((nees > tenth) & (nees <= near), np.sqrt(1.001 * near / nees), inner), np.ones(INSTANTS)


def small(errors: Array) -> tuple[Array, Array]:
    """A covariance 25 % too small."""
    return errors, np.full(errors.shape[1], 0.75)


def nees_of(
    filtered: Filter,
    random: np.random.Generator,
    number: int,
    over_time: float = 0.0,
    common: float = 0.0,
    course: float | None = None,
) -> MetricValue:
    """The NEES of so many runs of one scene, or of scenes with two runs each if these have something in common.

    Args:
        filtered: what the filter makes of whitened errors.
        random: where they come from.
        number: how many.
        over_time: correlation of successive errors.
        common: correlation of the errors of all objects and runs of a scene.
        course: of all objects, rad; drawn at random unless given.
    """
    each = 2 if common else 1
    runs = number * each
    own = _errors(random, OBJECTS, runs, over_time)
    if common:
        shared = np.repeat(_errors(random, 1, number, over_time), each, axis=3)
        own = np.sqrt(1.0 - common) * own + np.sqrt(common) * shared
    errors, variances = filtered(own)
    angle = (
        random.uniform(-np.pi, np.pi, (INSTANTS, OBJECTS, 1))
        if course is None
        else np.full((INSTANTS, OBJECTS, 1), course)
    )
    truth = np.stack([0 * angle, 0 * angle, 10 * np.cos(angle), 10 * np.sin(angle)])
    scene, metrics = np.repeat(np.arange(number), each) if common else np.zeros(runs, dtype=int), [Nees()]
    sums = [_sums(truth, errors[..., scene == own], variances) for own in np.unique(scene)]
    return evaluate(merge_sums(sums, metrics), scene, metrics).values["nees"]


def _sums(truth: Array, errors: Array, variances: Array) -> MetricSums:
    """What a scorer makes of errors ``(4, instants, objects, runs)`` in the runs of one scene."""
    runs = errors.shape[3]
    target = Target(
        time=np.arange(INSTANTS) * DT,
        state=truth,
        alive=np.ones((INSTANTS, OBJECTS), dtype=bool),
        due=np.ones((INSTANTS, OBJECTS, runs), dtype=bool),
        starting=np.zeros((INSTANTS, OBJECTS, runs), dtype=bool),
        divergence=1e9,
        reference=np.zeros((2, INSTANTS, OBJECTS, 1)),
    )
    scorer = Scorer(target, _classes(), {})
    for instant in range(INSTANTS):
        covariance = np.broadcast_to(variances[instant] * np.eye(4)[..., None], (4, 4, OBJECTS * runs))
        scorer.estimate(Estimate((truth[:, instant] + errors[:, instant]).reshape(4, -1), covariance))
    return scorer.close()


def _errors(random: np.random.Generator, objects: int, runs: int, over_time: float) -> Array:
    """``(4, instants, objects, runs)`` normal, of unit variance."""
    errors = random.standard_normal((4, INSTANTS, objects, runs))
    rest = np.sqrt(1.0 - over_time**2)
    for instant in range(1, INSTANTS):
        errors[:, instant] = over_time * errors[:, instant - 1] + rest * errors[:, instant]
    return errors


def _classes() -> Classes:
    """``(instants, objects, 1)``"""
    ends = np.cumsum(np.tile(np.array(SHARES) / 3, 3))
    manoeuvre = np.searchsorted(ends, (np.arange(INSTANTS) + 0.5) / INSTANTS) % len(MANOEUVRES)
    age = np.where(np.arange(INSTANTS) * DT < 1.0, 0, AGES.index("later"))
    codes = np.ravel_multi_index(np.broadcast_arrays(manoeuvre[:, None], BANDS, age[:, None], 0), SHAPE)
    return np.asarray(codes[..., None], dtype=np.int16)


#: Correlations over time, and of the errors of all objects and runs of a scene.
CORRELATIONS = tuple(product((0.0, 0.5, 0.9), (0.0, 0.5, 0.9)))
#: Scenes, or runs of one, and how often each case is repeated.
NUMBERS, REPEATS = (10, 20, 100), 40
FAULTY = {
    "covariance times 40 and .51 in turn": alternating,
    "10 % beyond the 95 % point, mean NEES 4": beyond,
    "covariance 25 % too small": small,
}


def claims() -> Iterator[Claim]:
    """A matched filter is not accused, three faults are found, and the intervals of the shares cover them."""
    for number in NUMBERS:
        items = {case: [_simulated(matched, number, *case, seed) for seed in range(REPEATS)] for case in CORRELATIONS}
        yield from _of_matched(f"matched filter, {number} runs", items)
    for what, filtered in FAULTY.items():
        verdicts = [_simulated(filtered, 100, *case, seed).verdict for case in CORRELATIONS for seed in range(10)]
        finds = [verdict not in ("consistent", "undecided") for verdict in verdicts]
        yield rate(f"{what}, 100 runs: shown to be off", finds, 0.95, 1.0)


def _of_matched(what: str, items: Mapping[tuple[float, float], Sequence[MetricValue]]) -> Iterator[Claim]:
    """By correlation over time and within a scene, the NEES of each repeat."""
    shares = {case: np.mean([item.verdict == "consistent" for item in repeats]) for case, repeats in items.items()}
    off = {case: [item.verdict not in ("consistent", "undecided") for item in of] for case, of in items.items()}
    (time, common), hits = max(off.items(), key=lambda item: sum(item[1]))
    yield rate(f"{what}: off, all {len(items)} correlations", [hit for each in off.values() for hit in each], 0.0, 0.05)
    yield rate(f"{what}: off, most with correlations {time:g} over time and {common:g} in a scene", hits, 0.0, 0.05)
    alone = [item.verdict == "consistent" for (_, common), repeats in items.items() if not common for item in repeats]
    yield rate(f"{what} that have nothing in common: consistent", alone, 0.95, 1.0)
    shared = [item.verdict == "consistent" for (_, common), repeats in items.items() if common for item in repeats]
    least = min(shares, key=lambda case: shares[case])
    claim = rate(f"{what} of scenes with correlated errors: consistent", shared, 0.95, 1.0)
    yield claim._replace(measured=f"{claim.measured}, least {100 * shares[least]:.0f} % with {least}")
    for point in BEYOND:
        name = f"beyond the {point} point"
        parts = [part for of in items.values() for item in of for part in item.parts or () if part.name == name]
        covers = [part.ci95[0] <= part.expected <= part.ci95[1] for part in parts]
        if covers:
            yield rate(f"{what}: the interval of the share {name} covers it", covers, 0.93, 1.0)


def _simulated(filtered: Filter, number: int, over_time: float, common: float, seed: int) -> MetricValue:
    random = np.random.default_rng([seed, number, int(10 * over_time), int(10 * common)])
    return nees_of(filtered, random, number, over_time, common)
