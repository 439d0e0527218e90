"""Scores under each condition: manoeuvre, range, time in view, and velocity jump of the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.conditions import AGES, BAND_EDGES, BANDS, JUMPS, MANOEUVRES, SHAPE
from trackbench.metrics.consistency import BEYOND, DIRECTIONS, beyond_path
from trackbench.metrics.count_intervals import effective_number, share_interval
from trackbench.metrics.intervals import Parts, positive_ends, reach_of_ratio
from trackbench.metrics.sums import ERROR_FIELDS, BlockScores, ClassSums
from trackbench.results import ConditionScores, MetricValue

#: Fields of the sums of a class of estimates, with the rows of the sums of errors that each field adds up.
FIELDS = {
    "count": ("count",),
    "given": ("given",),
    "position": ("px", "py"),
    "velocity": ("vx", "vy"),
    "nees": ("nees",),
    "nees_position": ("nees_position",),
    "nees_velocity": ("nees_velocity",),
    "nees_along": ("nees_along",),
    "nees_across": ("nees_across",),
    "nees_velocity_along": ("nees_velocity_along",),
    "nees_velocity_across": ("nees_velocity_across",),
}
#: Rows of the sums of a class: the fields, and the number of NEES beyond each point of chi-square.
ROWS = (*FIELDS, *BEYOND)
#: Degrees of freedom of the NEES and its parts. Each is a mean over the estimates that the tracker gave.
DOF = {"nees": 4, "nees_position": 2, "nees_velocity": 2} | dict.fromkeys(DIRECTIONS.values(), 1)
#: Least number of independent estimates expected beyond a point for its share to be stated.
LEAST_BEYOND = 10

# Columns of the sums: all estimates, each manoeuvre, band, age, and jump or none.
_MANOEUVRE = 1
_BAND = _MANOEUVRE + len(MANOEUVRES)
_AGE = _BAND + BANDS
_JUMP = _AGE + len(AGES)
_COLUMNS = _JUMP + len(JUMPS)
# Row that holds the number of terms of each row: of given estimates for a NEES, else of all errors.
_NUMBER = [1 if name in DOF or name in BEYOND else 0 for name in ROWS]
_COMBINED = np.array([[float(row in rows) for row in ERROR_FIELDS] for rows in FIELDS.values()])


def class_sums(codes: Indices, errors: Array, beyond: Array) -> ClassSums:
    """Return the sums of errors and NEES under each condition, with their moments over runs or stretches.

    Args:
        codes: ``(classes,)`` flat index of each class in :data:`trackbench.metrics.conditions.SHAPE`.
        errors: ``(15, classes, parts)`` sums of the errors of each class, rows ``ERROR_FIELDS``.
        beyond: ``(3, classes, parts)`` numbers of NEES beyond each point of chi-square.
    """
    manoeuvre, band, age, jump = np.unravel_index(codes, SHAPE)
    columns = np.stack([0 * band, _MANOEUVRE + manoeuvre, _BAND + band, _AGE + age, _JUMP + jump])
    counts = (columns[..., None] == np.arange(_COLUMNS)).any(axis=0)
    values = np.concatenate([np.tensordot(_COMBINED, errors, 1), beyond])
    return moments(np.einsum("kc,rkp->prc", counts.astype(float), values, optimize=True))


def moments(by_part: Array) -> ClassSums:
    """Return total, squares and products over parts of the sums in each part, ``(parts, fields, conditions)``."""
    return ClassSums(
        total=by_part.sum(axis=0),
        square=(by_part**2).sum(axis=0),
        product=(by_part * by_part[:, _NUMBER]).sum(axis=0),
        parts=(by_part[:, :1] > 0).sum(axis=0).astype(float),
    )


def joined_classes(blocks: Sequence[tuple[int, ClassSums]], scene: Indices | None) -> ClassSums:
    """Merge the sums under each condition from several blocks of runs.

    Args:
        blocks: number of runs and sums of each block.
        scene: ``(runs,)`` scene of each run where scenes are the independent parts; None to keep the parts (runs or
            stretches of time) of the blocks.
    """
    if scene is None:
        names = ("total", "square", "product", "parts")
        return ClassSums(**{name: np.sum([getattr(item, name) for _, item in blocks], axis=0) for name in names})
    first = np.cumsum([0, *(runs for runs, _ in blocks)])[:-1]
    by_scene = np.zeros((scene[-1] + 1, len(ROWS), _COLUMNS))
    np.add.at(by_scene, scene[first], np.stack([item.total for _, item in blocks]))
    return moments(by_scene)


def breakdown(scores: BlockScores) -> dict[str, ConditionScores]:
    """Return one tracker's errors and NEES under each condition that occurred; the key "" holds all estimates."""
    ((_, sums),), scenes = scores.classes, scores.scenes
    if not sums.total[0, 0]:
        return {"": ConditionScores(count=0, given=0, runs=0)}
    bands = map(band_name, range(BANDS))
    groups = {"manoeuvre": MANOEUVRES, "range": bands, "age": AGES, "jump": JUMPS}
    names = ["", *(f"{group}: {name}" for group, names in groups.items() for name in names)]
    return {name: _scores(sums, scenes, column) for column, name in enumerate(names) if sums.total[0, column]}


def band_name(band: int) -> str:
    """Return the text of a range band, such as "20 to 50 m"."""
    low, high = (0.0, *BAND_EDGES, None)[band : band + 2]
    if high is None:
        return f"above {low:g} m"
    return f"{low:g} to {high:g} m"


def _scores(sums: ClassSums, scenes: bool, column: int) -> ConditionScores:
    parts = Parts(int(sums.parts[0, column]), scenes)
    values = {
        name if name in DOF else f"{name}_rmse": _value(sums, row, column, name, parts)
        for row, name in enumerate(FIELDS)
        if name not in ("count", "given")
    }
    count, given = (int(number) for number in sums.total[:2, column])
    metrics = values | _beyond(sums, column, parts)
    return ConditionScores(count=count, given=given, runs=parts.number, metrics=metrics)


def _value(sums: ClassSums, row: int, column: int, name: str, parts: Parts) -> MetricValue:
    number = _NUMBER[row]
    if not sums.total[number, column]:
        return MetricValue(unit="1", dof=DOF[name], reason="no estimate was given")
    mean = float(sums.total[row, column] / sums.total[number, column])
    reach = _reach(sums, row, column)
    if name in DOF:
        return _with_reach(mean, reach, parts, unit="1", dof=DOF[name])
    error = math.sqrt(mean)
    # The root's interval by the delta method.
    slope = 0.5 / error if error > 0 else 0.0
    return _with_reach(error, slope * reach, parts, unit="m" if name == "position" else "m/s")


def _reach(sums: ClassSums, row: int, column: int) -> float:
    number = _NUMBER[row]
    return reach_of_ratio(
        total=sums.total[row, column],
        count=sums.total[number, column],
        square=sums.square[row, column],
        product=sums.product[row, column],
        count_square=sums.square[number, column],
        runs=int(sums.parts[0, column]),
    )


def _beyond(sums: ClassSums, column: int, parts: Parts) -> dict[str, MetricValue]:
    """Return the share of the NEES beyond each point of chi-square, by path, where enough estimates are expected.

    The variance of a rare share is badly known, and too small where few NEES happen to lie beyond. So the design effect
    is at least as large as at each nearer point. With normal errors the true design effect is smaller, since extremes
    depend less on each other.
    """
    shares: dict[str, MetricValue] = {}
    given = sums.total[1, column]
    if not given or parts.too_few:
        return shares
    effective = given
    for row, (point, expected) in enumerate(BEYOND.items(), len(FIELDS)):
        share = float(sums.total[row, column] / given)
        number = effective_number(share, given, parts.stretch.difference * _reach(sums, row, column))
        if number or not shares:
            effective = min(effective, number)
        if effective * expected < LEAST_BEYOND:
            break
        shares[beyond_path(point)] = MetricValue(value=share, unit="1", ci95=share_interval(share, effective))
    return shares


def _with_reach(value: float, reach: float, parts: Parts, **more: Any) -> MetricValue:
    if parts.too_few:
        return MetricValue(value=value, reason=parts.too_few, **more)
    return MetricValue(value=value, ci95=positive_ends(value, reach, parts.stretch), **more)
