"""Sums of errors, NEES and NIS that all built-in metrics share: small for any number of runs, and merged exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trackbench.base.types import Array, Indices

#: Squared error, NEES or NIS above which sums would overflow.
OVERFLOW = 1e100
#: Rows of the sums of errors: number of errors and squared errors; NEES of the state, of the position and the velocity
#: alone, and of each along and across the true velocity (1 degree of freedom); squared errors of the reference; number
#: of errors of given estimates, which alone have a NEES.
ERROR_FIELDS = (
    "count",
    "px",
    "py",
    "vx",
    "vy",
    "nees",
    "nees_position",
    "nees_velocity",
    "nees_along",
    "nees_across",
    "nees_velocity_along",
    "nees_velocity_across",
    "position_reference",
    "velocity_reference",
    "given",
)
#: Rows of the sums of innovations. Pairs are successive measurements of one object. An innovation that the tracker did
#: not give is missing if it had an estimate before the measurement.
NIS_FIELDS = ("count", "nis", "inside", "pairs", "product", "square", "missing")
ERROR, NIS = ({name: row for row, name in enumerate(names)} for names in (ERROR_FIELDS, NIS_FIELDS))
#: Largest number and least duration, s, of the stretches of time of a single run. Their sums are taken as independent:
#: an error is forgotten within a few measurements.
STRETCHES, SHORTEST = 20, 4.0


def stretch_numbers(instants: int, duration: float) -> Indices:
    """Return the index of the stretch of time that each instant of a run is in, ``(instants,)``; ``duration`` in s."""
    count = min(STRETCHES, max(1, int(duration / SHORTEST)))
    return np.arange(instants) * count // max(instants, 1)


@dataclass
class NisScores:
    """Sums over the innovations of one sensor: number, NIS, and products of successive innovations."""

    dof: int
    """Number of components of the innovation; 0 while the tracker has given none."""
    per_step: Array
    """``(7, measurements)`` sums over objects and runs at each measurement: number of innovations, their NIS, and the
    other rows of ``NIS_FIELDS``."""
    per_run: Array
    """``(7, runs)`` sums over measurements and objects in each run: number of innovations, their NIS, and the other
    rows of ``NIS_FIELDS``."""
    per_part: Array
    """``(7, parts)`` sums in each independent part (scene, run or stretch of a run): number of innovations, their NIS,
    and the other rows of ``NIS_FIELDS``."""


@dataclass
class ClassSums:
    """Sums over the estimates under each condition, and their moments over independent parts.

    Arrays are ``(fields, conditions)``.
    """

    total: Array
    """``(fields, conditions)`` sum of each field over all estimates: number of errors, squared errors, NEES, and number
    of NEES beyond each point of chi-square."""
    square: Array
    """Square of the sum of each field within a part (a run or scene), added over the parts."""
    product: Array
    """Sum over the parts (runs or scenes) of a field's sum in the part times its number of terms there. The terms of a
    NEES are the estimates that the tracker gave; those of other fields include charges for missing estimates."""
    parts: Array
    """``(1, conditions)`` number of independent parts (runs or scenes) with an estimate under the condition."""


@dataclass
class BlockScores:
    """Sums over the estimates of one tracker in a block of runs, or in several merged blocks.

    Intervals rest on independent parts: the runs, or the stretches of a single run. If there are several scenes,
    :func:`trackbench.metrics.evaluate.independent_scores` makes the scenes the parts.
    """

    per_step: Array
    """``(15, instants)`` sums over objects and runs, of squared errors, NEES and the other rows of ``ERROR_FIELDS``."""
    per_run: Array
    """``(15, runs)`` sums over instants and objects, of squared errors, NEES and the other rows of ``ERROR_FIELDS``."""
    per_part: Array
    """``(15, parts)`` sums within independent parts, of squared errors, NEES and the other rows of ``ERROR_FIELDS``."""
    charged: Array
    """``(15, parts)`` portion of the sums ``per_part`` that is charged for missing estimates."""
    due: Array
    """``(runs,)`` number of estimates, over instants and objects, that a tracker should give."""
    diverged: Array
    """``(runs,)`` 1 for a run in which a position error exceeded the divergence limit, else 0."""
    repaired: Array
    """``(runs,)`` number of covariances that were repaired in each run."""
    nis: dict[str, NisScores]
    """Sums over the innovations of each sensor, by name of the sensor."""
    classes: list[tuple[int, ClassSums]]
    """Number of runs, and sums under each condition, of each merged block of runs; in the end a single pair for all
    runs."""
    stretches: list[int] | None = None
    """Number of stretches of time that each run is cut into; None where runs are not cut."""
    scenes: bool = False
    """Whether the independent parts in ``per_part`` and ``charged`` are scenes; else they are runs or stretches of a
    run."""

    @property
    def given(self) -> float:
        """Number of estimates, over all runs, instants and objects, that were due and that the tracker gave."""
        return float(self.per_run[ERROR["given"]].sum())

    @property
    def coverage(self) -> float:
        """Share of the due estimates that were given; NaN if none was due."""
        due = float(self.due.sum())
        return self.given / due if due else float("nan")


def merge(blocks: Sequence[BlockScores]) -> BlockScores:
    """Merge the sums of consecutive blocks of runs in their order; later blocks can have fewer instants."""
    first = blocks[0]
    by_run: dict[str, Any] = _joined(blocks, ("per_run", "per_part", "charged", "due", "diverged", "repaired"))
    return replace(
        first,
        per_step=_total([block.per_step for block in blocks]),
        **by_run,
        nis={name: _merged_nis([block.nis[name] for block in blocks]) for name in first.nis},
        classes=[item for block in blocks for item in block.classes],
        stretches=None if first.stretches is None else [item for block in blocks for item in block.stretches or ()],
    )


def _merged_nis(parts: Sequence[NisScores]) -> NisScores:
    per_step = _total([part.per_step for part in parts])
    return NisScores(max(part.dof for part in parts), per_step, **_joined(parts, ("per_run", "per_part")))


def _joined(parts: Sequence[Any], names: Sequence[str]) -> dict[str, Array]:
    return {name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names}


def added(sums: Array, part: Indices) -> Array:
    """Sum the columns of ``(rows, columns)`` by the part that each belongs to, ``part``, to ``(rows, parts)``."""
    return np.stack([np.bincount(part, row) for row in sums])


def _total(parts: Sequence[Array]) -> Array:
    longest = max(part.shape[-1] for part in parts)
    total = np.zeros((*parts[0].shape[:-1], longest))
    for part in parts:
        total[..., : part.shape[-1]] += part
    return total
