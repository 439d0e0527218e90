"""The sums that all built-in metrics share: small enough for any number of runs, and they merge exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array, Indices

#: Where a squared error, a NEES or a NIS is beyond this, sums of them would overflow.
OVERFLOW = 1e100
#: Rows of the sums of errors: number of errors, squared errors, and the same for the course where it is defined;
#: the NEES of the position and of the velocity by themselves, and of each along and across the true velocity (1 degree
#: of freedom); the reference of the squared errors; and how many of the errors are of an estimate that the tracker
#: gave, which alone have a NEES.
ERROR_FIELDS = (
    "count",
    "px",
    "py",
    "vx",
    "vy",
    "nees",
    "course_count",
    "course",
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
#: Rows of the sums of innovations; pairs are successive measurements of one object, and an innovation is missing where
#: the tracker had an estimate before the measurement.
NIS_FIELDS = ("count", "nis", "inside", "pairs", "product", "square", "missing")
#: Rows of the sums of innovations per lag: pairs of measurements so far apart of which both count, their products, and
#: the squares of the later ones.
LAG_FIELDS = ("pairs", "product", "square")
ERROR, NIS = ({name: row for row, name in enumerate(names)} for names in (ERROR_FIELDS, NIS_FIELDS))
#: Lags of the autocorrelation, in measurements.
LAGS = 20
#: A single run is cut into at most so many stretches of time, none shorter than this, s, whose sums are taken for
#: independent: an error is forgotten within a few measurements.
STRETCHES, SHORTEST = 20, 4.0


def stretch_numbers(instants: int, duration: float) -> Indices:
    """``(instants,)`` number of the stretch of each of the instants of so many seconds."""
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
    lags: Array
    """``(3, LAGS + 1)`` sums over steps, objects and runs, rows ``LAG_FIELDS``."""


@dataclass
class Cells:
    """Sums over the estimates of each class in each part, such as a run; those that occurred."""

    code: Indices
    """``(cells,)`` the class, as :func:`trackbench.metrics.conditions.condition_classes` counts them."""
    part: Indices
    """``(cells,)`` number of the part."""
    values: Array
    """``(14, cells)`` sums, rows ``FIELDS`` of the breakdown."""


@dataclass
class ErrorSums:
    """Sums over the estimates of one tracker."""

    per_step: Array
    """``(17, instants)`` sums over objects and runs, rows ``ERROR_FIELDS``."""
    per_run: Array
    """``(17, runs)`` sums over instants and objects, rows ``ERROR_FIELDS``."""
    charged_per_step: Array
    """Those of ``per_step`` that the tracker is charged with where it gave no estimate."""
    charged_per_run: Array
    """Those of ``per_run``."""
    cells: Cells
    """In each run, or stretch of a single one; once ``classes`` are summed, in all of a block, as the first part."""
    classes: ClassSums | None = None
    """With the runs, or the stretches of a single one, as parts."""


@dataclass
class BlockScores:
    """Sums over the estimates of one tracker in a block of runs; they merge exactly."""

    errors: ErrorSums
    due: Array
    """``(runs,)`` number of instants and objects at which there should be an estimate."""
    diverged: Array
    """``(runs,)`` 1 where an error exceeded the limit."""
    repaired: Array
    """``(runs,)`` number of repaired covariances."""
    nis: dict[str, NisScores]
    """By sensor."""
    spread: Array
    """``(2, instants)`` 10th and 90th percentile of the position error over the runs of the first block."""
    duration: float
    """From the first instant to the last, s."""
    single_runs: tuple[BlockScores, ...] | None = None
    """Each run by itself, where stretches of time stand for independent runs; of one that is not merged yet ``()``."""

    @property
    def stretch(self) -> Indices:
        """``(instants,)`` number of the stretch of time of each instant of a single run."""
        return stretch_numbers(self.errors.per_step.shape[1], self.duration)

    @property
    def given(self) -> float:
        """Number of estimates that were due and given."""
        return float(self.errors.per_run[ERROR["given"]].sum())

    @property
    def coverage(self) -> float:
        """Share of the instants and objects at which there should be an estimate that have one; NaN of none."""
        due = float(self.due.sum())
        return self.given / due if due else float("nan")


@dataclass
class ClassSums:
    """Sums over the estimates of each class, and their moments over independent parts, each ``(fields, classes)``."""

    total: Array
    """Sums; the first field is their number."""
    square: Array
    """Squares of the sum of each part."""
    product: Array
    """The sum of each part times the number of errors, of a NEES times that of estimates, in it."""
    parts: Array
    """``(1, classes)`` number of parts with an estimate of the class."""
    scenes: bool
    """Whether the parts are scenes."""


@dataclass
class Scores:
    """What the built-in metrics are made of: the sums of one tracker over all runs.

    The parts are independent of each other: scenes; where there is one, runs; of a single run, and of few logs, the
    stretches of time.
    """

    per_step: Array
    """``(17, instants)`` rows ``ERROR_FIELDS``."""
    per_run: Array
    """``(17, runs)`` rows ``ERROR_FIELDS``."""
    per_part: Array
    """``(17, parts)`` rows ``ERROR_FIELDS``."""
    charged: Array
    """``(17, parts)`` those of ``per_part`` that the tracker is charged with where it gave no estimate."""
    scenes: bool
    """Whether the parts are scenes."""
    given: float
    """Number of estimates that were due and given."""
    due: float
    """Number of instants and objects at which there should be one."""
    nis: dict[str, NisScores]
    """By sensor; in place of the runs the parts."""
    classes: ClassSums
    """By condition."""
    spread: Array
    """``(2, instants)`` 10th and 90th percentile of the position error over the runs of the first block."""


def merge(blocks: Sequence[BlockScores]) -> BlockScores:
    """The scores of consecutive blocks of runs, added in their order; later scenes may be shorter."""
    first = blocks[0]
    parts = [len(block.due) if block.single_runs is None else block.stretch[-1] + 1 for block in blocks]
    errors = [block.errors for block in blocks]
    longest = max(block.spread.shape[1] for block in blocks)
    return BlockScores(
        errors=ErrorSums(
            per_step=_total([sums.per_step for sums in errors]),
            per_run=np.concatenate([sums.per_run for sums in errors], axis=1),
            charged_per_step=_total([sums.charged_per_step for sums in errors]),
            charged_per_run=np.concatenate([sums.charged_per_run for sums in errors], axis=1),
            cells=_joined([sums.cells for sums in errors], np.cumsum([0, *parts[:-1]]).tolist()),
            classes=_added([sums.classes for sums in errors if sums.classes is not None]),
        ),
        due=np.concatenate([block.due for block in blocks]),
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
        spread=np.pad(first.spread, ((0, 0), (0, longest - first.spread.shape[1])), constant_values=np.nan),
        duration=max(block.duration for block in blocks),
        single_runs=None if first.single_runs is None else tuple(blocks),
    )


def _added(classes: Sequence[ClassSums]) -> ClassSums | None:
    """Of all their parts."""
    names = ("total", "square", "product", "parts")
    sums = {name: _total([getattr(item, name) for item in classes]) for name in names if classes}
    return ClassSums(**sums, scenes=False) if sums else None


def _joined(cells: Sequence[Cells], first: Sequence[int]) -> Cells:
    """All of them; ``first``: the number of the first run or stretch of each."""
    return Cells(
        np.concatenate([item.code for item in cells]),
        np.concatenate([item.part + at for item, at in zip(cells, first, strict=True)]),
        np.concatenate([item.values for item in cells], axis=1),
    )


def _total(parts: Sequence[Array]) -> Array:
    """The sum of arrays whose last axes begin alike and may end earlier."""
    longest = max(part.shape[-1] for part in parts)
    total = np.zeros((*parts[0].shape[:-1], longest))
    for part in parts:
        total[..., : part.shape[-1]] += part
    return total
