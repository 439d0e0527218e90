"""The sums that all built-in metrics share: small enough for any number of runs, and they merge exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from trackbench.types import Array

#: Where a squared error, a NEES or a NIS is beyond this, sums of them would overflow.
OVERFLOW = 1e100
#: Rows of the sums of errors: number of estimates, squared errors, and the same for the course where it is defined;
#: the last two are the NEES of the position and of the velocity by themselves.
ERROR_FIELDS = ("count", "px", "py", "vx", "vy", "nees", "course_count", "course", "nees_position", "nees_velocity")
#: Rows of the sums of innovations per step.
NIS_STEP_FIELDS = ("count", "nis", "inside")
#: Rows of the sums of innovations per run; pairs are successive measurements of one object.
NIS_RUN_FIELDS = ("count", "nis", "inside", "pairs", "product", "square")
#: Rows of the sums of innovations per lag: pairs of measurements so far apart of which both count, their products, and
#: the squares of the later ones.
LAG_FIELDS = ("pairs", "product", "square")
ERROR, NIS_STEP, NIS_RUN = (
    {name: row for row, name in enumerate(names)} for names in (ERROR_FIELDS, NIS_STEP_FIELDS, NIS_RUN_FIELDS)
)
#: Lags of the autocorrelation, in measurements.
LAGS = 20


@dataclass
class NisScores:
    """Sums over the innovations of one sensor."""

    dof: int
    """Dimension of the innovation; 0 while the tracker gave none."""
    per_step: Array
    """``(3, measurements)`` sums over objects and runs, rows ``NIS_STEP_FIELDS``."""
    per_run: Array
    """``(6, runs)`` sums over steps and objects, rows ``NIS_RUN_FIELDS``."""
    lags: Array
    """``(3, LAGS + 1)`` sums over steps, objects and runs, rows ``LAG_FIELDS``."""


@dataclass
class ClassSums:
    """Sums over the estimates of each class, and their moments over the runs, each ``(fields, classes)``."""

    total: Array
    """Sums; the first field is their number."""
    square: Array
    """Squares of the sum of each run."""
    product: Array
    """The sum of each run times its number."""
    runs: Array
    """``(1, classes)`` number of runs with an estimate of the class."""


@dataclass(frozen=True)
class Bound:
    """Root mean square of the Cramer-Rao bound over the scored instants and objects; NaN where there is none."""

    position: float
    """m"""
    velocity: float
    """m/s"""


NO_BOUND = Bound(float("nan"), float("nan"))


@dataclass
class Scores:
    """Sums over the estimates of one tracker in a block of runs."""

    per_step: Array
    """``(10, instants)`` sums over objects and runs, rows ``ERROR_FIELDS``."""
    per_run: Array
    """``(10, runs)`` sums over instants and objects, rows ``ERROR_FIELDS``."""
    weight: Array
    """``(instants, objects)`` number of runs with a scored estimate."""
    present: Array
    """``(runs,)`` number of instants and objects at which there should be an estimate."""
    diverged: Array
    """``(runs,)`` 1 where an error exceeded the limit."""
    repaired: Array
    """``(runs,)`` number of repaired covariances."""
    nis: dict[str, NisScores]
    """By sensor."""
    classes: ClassSums
    """By manoeuvre and range band."""
    spread: Array
    """``(2, instants)`` 10th and 90th percentile of the position error over the runs of the first block."""
    seconds: float
    """Time spent in the tracker."""
    steps: int
    """Number of steps of single objects that it took."""
    bound: Bound = NO_BOUND
    """What errors are held against; known once all runs are."""


def merge(blocks: Sequence[Scores]) -> Scores:
    """The scores of consecutive blocks of runs, added in their order."""
    first = blocks[0]
    return Scores(
        per_step=_total([block.per_step for block in blocks]),
        per_run=np.concatenate([block.per_run for block in blocks], axis=1),
        weight=_total([block.weight for block in blocks]),
        present=np.concatenate([block.present for block in blocks]),
        diverged=np.concatenate([block.diverged for block in blocks]),
        repaired=np.concatenate([block.repaired for block in blocks]),
        nis={
            name: NisScores(
                dof=max(block.nis[name].dof for block in blocks),
                per_step=_total([block.nis[name].per_step for block in blocks]),
                per_run=np.concatenate([block.nis[name].per_run for block in blocks], axis=1),
                lags=_total([block.nis[name].lags for block in blocks]),
            )
            for name in first.nis
        },
        classes=ClassSums(
            *(_total([getattr(block.classes, field.name) for block in blocks]) for field in fields(ClassSums))
        ),
        spread=first.spread,
        seconds=sum(block.seconds for block in blocks),
        steps=sum(block.steps for block in blocks),
    )


def _total(parts: Sequence[Array]) -> Array:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
