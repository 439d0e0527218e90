"""The conditions under which a mean NEES is held against what a verdict tolerates."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.breakdown import DOF, band_name
from trackbench.metrics.conditions import AGES, BANDS, MANOEUVRES, SHAPE, Classes
from trackbench.metrics.verdicts import ABOVE, BELOW, HALVES, SMALLEST_SHARE
from trackbench.subjects.tuning.measures import Sums

#: Each manoeuvre, each range band and the first second.
CONDITIONS = (*MANOEUVRES, *(band_name(band) for band in range(BANDS)), AGES[0])
#: How far the logarithm of a mean over its degrees of freedom may be off, below and above: somewhat less than what the
#: verdict tolerates, so that it holds on other scenes too.
LOW, HIGH = 0.7 * math.log(1.0 - BELOW), 0.7 * math.log(1.0 + ABOVE)


def members(classes: Classes) -> Array:
    """``(conditions, instants, objects, runs or 1)`` 1 where an object is under a condition.

    Args:
        classes: ``(instants, objects, runs or 1)`` as ``metrics.conditions`` gives them.
    """
    manoeuvre, band, age, _ = np.unravel_index(classes, SHAPE)
    found = [
        *(manoeuvre == number for number in range(len(MANOEUVRES))),
        *(band == number for number in range(BANDS)),
        age == 0,
    ]
    return np.stack(found).astype(float)


def off(sums: Sums, start: Sums) -> Iterator[tuple[str, float]]:
    """By condition of which the start gives enough estimates, the logarithm of the mean NEES over its degrees of
    freedom: of every trial the same conditions."""
    everything = start.values["nees"][1].sum()
    for name in (*CONDITIONS, *HALVES):
        if start.values[name][1].sum() >= SMALLEST_SHARE * everything:
            dof = DOF["nees_position"] if name in HALVES else DOF["nees"]
            yield name, float(np.log(sums.value(name) / dof))


def excess(value: float) -> float:
    """How far such a logarithm is beyond what is allowed."""
    return max(0.0, value - HIGH, LOW - value)
