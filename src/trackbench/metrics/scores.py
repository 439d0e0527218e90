"""What is kept of a tracker's estimates: sums, small enough for any number of runs, that merge exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.types import Array

#: Rows of the sums of errors: number of estimates, squared errors, and the same for the course where it is defined.
ERROR_FIELDS = ("count", "px", "py", "vx", "vy", "nees", "course_count", "course")
#: Rows of the sums of innovations per step.
NIS_STEP_FIELDS = ("count", "nis", "inside")
#: Rows of the sums of innovations per run; pairs are successive readings of one object.
NIS_RUN_FIELDS = ("count", "nis", "inside", "pairs", "product", "square")


@dataclass
class NisScores:
    """Sums over the innovations of one sensor."""

    dof: int
    """Dimension of the innovation; 0 while the tracker gave none."""
    per_step: Array
    """``(3, readings)`` sums over objects and runs, rows ``NIS_STEP_FIELDS``."""
    per_run: Array
    """``(6, runs)`` sums over steps and objects, rows ``NIS_RUN_FIELDS``."""


@dataclass
class Scores:
    """Sums over the estimates of one tracker in a block of runs."""

    per_step: Array
    """``(8, instants)`` sums over objects and runs, rows ``ERROR_FIELDS``."""
    per_run: Array
    """``(8, runs)`` sums over instants and objects, rows ``ERROR_FIELDS``."""
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
    spread: Array
    """``(2, instants)`` 10th and 90th percentile of the position error over the runs of the first block."""
    seconds: float
    """Time spent in the tracker."""
    steps: int
    """Number of steps of single objects that it took."""


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
            )
            for name in first.nis
        },
        spread=first.spread,
        seconds=sum(block.seconds for block in blocks),
        steps=sum(block.steps for block in blocks),
    )


def _total(parts: Sequence[Array]) -> Array:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
