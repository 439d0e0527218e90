"""Sums that all built-in metrics share: small enough for any number of runs, and merged exactly."""

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
    """Return the stretch number of each instant of a run of so many seconds, ``(instants,)``."""
    count = min(STRETCHES, max(1, int(duration / SHORTEST)))
    return np.arange(instants) * count // max(instants, 1)


@dataclass
class NisScores:
    """Sums over the innovations of one sensor."""

    dof: int
    """Dimension of the innovation; 0 while the tracker gave none."""
    per_step: Array
    """``(7, measurements)`` sums over objects and runs, rows ``NIS_FIELDS``."""
    per_run: Array
    """``(7, runs)`` sums over steps and objects, rows ``NIS_FIELDS``."""
    per_part: Array
    """``(7, parts)`` sums within the independent parts of ``BlockScores``."""


@dataclass
class ClassSums:
    """Sums over the estimates under each condition, and their moments over independent parts.

    Arrays are ``(fields, conditions)``.
    """

    total: Array
    """Sums; the first field is the number of errors."""
    square: Array
    """Squared sum of each part, added over parts."""
    product: Array
    """Sum of each part times its number of terms, added over parts; the terms are errors, or estimates for a NEES."""
    parts: Array
    """``(1, conditions)`` number of parts with an estimate under the condition."""


@dataclass
class BlockScores:
    """Sums over the estimates of one tracker in a block of runs, or in several merged blocks.

    Intervals rest on independent parts: the runs, or the stretches of a single run. If there are several scenes,
    :func:`trackbench.metrics.evaluate.independent_scores` makes the scenes the parts.
    """

    per_step: Array
    """``(15, instants)`` sums over objects and runs, rows ``ERROR_FIELDS``."""
    per_run: Array
    """``(15, runs)`` sums over instants and objects, rows ``ERROR_FIELDS``."""
    per_part: Array
    """``(15, parts)`` sums within independent parts, rows ``ERROR_FIELDS``."""
    charged: Array
    """Portion of ``per_part`` that is charged for missing estimates."""
    due: Array
    """``(runs,)`` number of instants and objects at which there should be an estimate."""
    diverged: Array
    """``(runs,)`` 1 where an error exceeded the limit."""
    repaired: Array
    """``(runs,)`` number of repaired covariances."""
    nis: dict[str, NisScores]
    """Sums of innovations by sensor."""
    classes: list[tuple[int, ClassSums]]
    """Number of runs and sums by condition of each merged block; a single entry once the parts are independent."""
    stretches: list[int] | None = None
    """Number of stretches of each single run; None where runs are not cut into stretches."""
    scenes: bool = False
    """Whether the parts are scenes."""

    @property
    def given(self) -> float:
        """Number of estimates that were due and given."""
        return float(self.per_run[ERROR["given"]].sum())

    @property
    def coverage(self) -> float:
        """Share of the due estimates that were given; NaN if none was due."""
        due = float(self.due.sum())
        return self.given / due if due else float("nan")


def merge(blocks: Sequence[BlockScores]) -> BlockScores:
    """Merge the scores of consecutive blocks of runs in their order; later scenes may be shorter."""
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
    """Add up sums ``(rows, ...)`` within each part, to ``(rows, parts)``."""
    return np.stack([np.bincount(part, row) for row in sums])


def _total(parts: Sequence[Array]) -> Array:
    """Add arrays whose last axes may differ in length, as if padded with zeros."""
    longest = max(part.shape[-1] for part in parts)
    total = np.zeros((*parts[0].shape[:-1], longest))
    for part in parts:
        total[..., : part.shape[-1]] += part
    return total
