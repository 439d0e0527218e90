"""Checks of a log that need no fit: its times, its units, and the velocity that the truth states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.subjects.log_audit.sensor_log import SensorLog
from trackbench.truth.config.columns import COMPONENT_QUANTITIES, UNITS, MeasurementColumns
from trackbench.truth.recorded.drive import Motion, RowOrder

#: A gap is longer than this many usual intervals.
GAP = 5.0


@dataclass(frozen=True)
class Clock:
    """The times of one sensor's rows, or of the truth's."""

    name: str
    order: RowOrder
    outside: int
    """Rows outside the time of the truth."""
    usual_s: float | None
    """Median interval between different times."""
    gaps: int
    longest_gap_s: float
    longest_gap_at_s: float
    time: Array
    """All different times, sorted, s."""


def clock_of(name: str, time: Array, order: RowOrder, outside: int = 0) -> Clock:
    """What there is to say of some times.

    Args:
        name: of the sensor, or "truth".
        time: ``(rows,)`` s.
        order: in which the rows stand in the file.
        outside: rows outside the time of the truth.
    """
    different = np.unique(time)
    intervals = np.diff(different)
    if not len(intervals):
        return Clock(name, order, outside, None, 0, 0.0, 0.0, different)
    usual, longest = float(np.median(intervals)), int(np.argmax(intervals))
    gaps = int((intervals > GAP * usual).sum())
    return Clock(name, order, outside, usual, gaps, float(intervals[longest]), float(different[longest]), different)


#: Another unit must make the spread of the residuals smaller by this factor.
CLEARLY = 3.0


@dataclass(frozen=True)
class WrongUnit:
    """A component that fits the truth in another unit."""

    component: str
    stated: str
    fits: str
    """The unit in which it fits."""
    turned: bool
    """Whether it also counts the other way."""
    factor: float
    """What the measurement, as read, is to be multiplied by."""
    spread: tuple[float, float]
    """Spread of the residuals as stated and in the other unit, SI units and rad."""


def wrong_units(log: SensorLog) -> Iterator[WrongUnit]:
    """The components whose residuals get clearly smaller in another unit."""
    entry = log.truth.measurements.get(log.name) or MeasurementColumns()
    expected = log.expected({})
    for i, (name, unit) in enumerate(zip(log.components, log.config.units, strict=True)):
        quantity = COMPONENT_QUANTITIES.get(unit)
        if quantity is None:
            continue
        known = np.isfinite(expected[i])
        measured, wanted, circular = log.measurement[i, known], expected[i, known], i in log.config.angular
        stated = entry.units.get(name) or str(getattr(log.truth.units, quantity))
        as_read = _spread(measured, wanted, circular)
        choices = {
            (other, turned): UNITS[quantity][other] / UNITS[quantity][stated] * (-1.0 if turned else 1.0)
            for other in UNITS[quantity]
            for turned in (False, True)
        }
        spreads = {choice: _spread(factor * measured, wanted, circular) for choice, factor in choices.items()}
        best = min(spreads, key=spreads.__getitem__)
        # What has become nearly zero fits as well as the truth itself changes.
        own = _spread(np.zeros_like(wanted), wanted, circular)
        if best != (stated, False) and CLEARLY * spreads[best] < min(as_read, own):
            yield WrongUnit(name, stated, best[0], best[1], choices[best], (as_read, spreads[best]))


def _spread(measured: Array, wanted: Array, circular: bool) -> float:
    """Median distance of the residuals from their middle."""
    residual = measured - wanted
    if circular:
        middle = np.angle(np.mean(np.exp(1j * residual)))
        residual = wrap_angle(residual - middle)
    return float(np.median(np.abs(residual - np.median(residual)))) if len(residual) else 0.0


#: The velocity is compared with the displacement over windows of this length, in which the noise of a position of a
#: few centimetres is below the tolerance, s.
WINDOW = 0.5
#: The largest difference that passes, m/s: the range-rate noise of a good automotive radar.
TOLERANCE_MPS = 0.1
#: A scale this near to that of another unit is taken for it.
NEAR = 0.03
#: Windows of motion without which nothing is said of an object.
FEWEST = 4


@dataclass(frozen=True)
class VelocityCheck:
    """The velocity of one body of the truth beside its displacement."""

    name: str
    time: Array
    """``(windows,)`` s, their middles."""
    stated: Array
    """``(windows,)`` speed by the stated velocity, m/s."""
    moved: Array
    """``(windows,)`` speed by the displacement, m/s."""
    difference: float
    """Median length of the difference of the two velocities, m/s."""
    scale: float
    """The displacement's velocity is this many times the stated one."""
    unit: str | None
    """The unit in which the stated speed would fit, if it is another one."""
    jumps: int
    """Windows with a displacement that no vehicle makes, beside the stated velocity."""

    @property
    def contradicts(self) -> bool:
        """Whether the velocity cannot be that of the motion."""
        return self.difference > TOLERANCE_MPS


#: A displacement that differs from the stated velocity by more than this many times its own spread is a jump; and m/s.
JUMP, JUMP_MPS = 10.0, 5.0


def velocity_check(name: str, motion: Motion, stated_unit: str) -> VelocityCheck | None:
    """Compare the velocity of a body with its displacement; None where it is too short.

    Args:
        name: of the body.
        motion: as recorded.
        stated_unit: of the speed.
    """
    edges = _windows(motion.time)
    if len(edges) <= FEWEST:
        return None
    dt = np.diff(motion.time[edges])
    moved = np.stack([np.diff(motion.px[edges]), np.diff(motion.py[edges])]) / dt
    steps = np.diff(motion.time)
    travelled = np.stack(
        [np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * steps)])[edges] for v in (motion.vx, motion.vy)]
    )
    stated = np.diff(travelled, axis=1) / dt
    apart = np.hypot(*(moved - stated))
    usual = float(np.median(apart))
    square = float((stated**2).sum())
    scale = float((moved * stated).sum() / square) if square > 0 else 1.0
    fits = None
    for unit, factor in UNITS["speed"].items():
        if unit != stated_unit and abs(scale * UNITS["speed"][stated_unit] / factor - 1) < NEAR:
            fits = unit
    jumps = int((apart > np.maximum(JUMP_MPS, usual + JUMP * 1.4826 * np.median(np.abs(apart - usual)))).sum())
    middle = 0.5 * (motion.time[edges][1:] + motion.time[edges][:-1])
    return VelocityCheck(name, middle, np.hypot(*stated), np.hypot(*moved), usual, scale, fits, jumps)


def _windows(time: Array) -> Array:
    """Numbers of the rows between which windows of at least the wanted length lie."""
    edges = [0]
    for row, instant in enumerate(time.tolist()):
        if instant - time[edges[-1]] >= WINDOW * (1 - 1e-9):
            edges.append(row)
    return np.array(edges, dtype=np.intp)
