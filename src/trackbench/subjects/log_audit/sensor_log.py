"""The measurements of one sensor of a log beside what it should have read, and checks that need no fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from trackbench.base.types import Array, Indices, Observer
from trackbench.base.units import difference, wrap_angle
from trackbench.models.sensors import Mount, Radar, Sensor
from trackbench.sensing.view import sensor_motion
from trackbench.subjects.log_audit.reference import ReferenceNoise
from trackbench.truth.config.columns import COMPONENT_QUANTITIES, UNITS, MeasurementColumns
from trackbench.truth.frames import fixed_observer
from trackbench.truth.recorded import Drive
from trackbench.truth.recorded.drive import Log, RowOrder, carrier
from trackbench.truth.sources import RecordingTruth

#: The errors of time and mounting that every sensor may have, with their units.
POSE_ERRORS = {"time_offset": "s", "mount_yaw": "rad", "mount_x": "m", "mount_y": "m"}
#: Steps of central differences; a time offset is differentiated over the rows of the reference.
_STEPS = {"mount_yaw": 1e-4, **dict.fromkeys(("mount_x", "mount_y", "px", "py", "vx", "vy"), 1e-3)}


@dataclass(frozen=True)
class SensorLog:
    """One sensor's part of a log, one row a detection within the time of the truth."""

    name: str
    config: Sensor
    log: Log
    drive: Drive
    truth: RecordingTruth
    noise: ReferenceNoise
    """Of the drive."""
    factors: Array
    """``(m,)`` what each component is multiplied by, where its unit was found to be another."""

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components of a measurement."""
        return self.config.components

    @property
    def errors(self) -> dict[str, str]:
        """All errors that are looked for, with their units: of time and mounting, and a bias of each component."""
        biases = {f"bias_{name}": unit for name, unit in zip(self.components, self.config.units, strict=True)}
        return {**POSE_ERRORS, **biases}

    @property
    def measurement(self) -> Array:
        """``(m, rows)``."""
        return self.log.measurement * self.factors[:, None]

    def rows(self, kept: Indices) -> SensorLog:
        """The log of some of its rows."""
        log = self.log
        chosen = log._replace(time=log.time[kept], object=log.object[kept], measurement=log.measurement[:, kept])
        return replace(self, log=chosen)

    def expected(self, errors: Mapping[str, float]) -> Array:
        """``(m, rows)`` the noise-free measurement, were the errors these; NaN outside the truth.

        Errors are those of the sensor, and "px", "py", "vx", "vy" of the truth of all objects.
        """
        time = self.log.time + errors.get("time_offset", 0.0)
        target = self.target(time, self.log.object)
        target += np.array([errors.get(name, 0.0) for name in ("px", "py", "vx", "vy")])[:, None]
        motion = sensor_motion(self.observer(time), self._mount(errors))
        seen = self.config.measure(target, motion.pose, motion.velocity)
        biases = np.array([errors.get(f"bias_{name}", 0.0) for name in self.components])
        return np.asarray(seen + biases[:, None])

    def residual(self, errors: Mapping[str, float]) -> Array:
        """``(m, rows)`` measurement minus what is expected, angles wrapped."""
        return difference(self.measurement, self.expected(errors), self.config.angular)

    def polar(self, time: Array, owner: Indices, errors: Mapping[str, float]) -> Array:
        """``(2, n)`` true range and azimuth of objects from the sensor at some times of its clock."""
        at = time + errors.get("time_offset", 0.0)
        motion = sensor_motion(self.observer(at), self._mount(errors))
        return np.asarray(Radar.measure(self.target(at, owner), motion.pose, motion.velocity)[:2])

    def target(self, time: Array, owner: Indices) -> Array:
        """``(4, n)`` px, py, vx, vy of objects; NaN where their truth, or the observer's, is not known."""
        state = np.full((4, len(time)), np.nan)
        for number, motion in enumerate(self.drive.motions.values()):
            first, last = self.drive.span(number)
            own = (owner == number) & (time >= first) & (time <= last)
            for row, values in enumerate((motion.px, motion.py, motion.vx, motion.vy)):
                state[row, own] = np.interp(time[own], motion.time, values)
        return state

    def observer(self, time: Array) -> Observer:
        """What carries the sensor."""
        if self.drive.observer is None:
            return fixed_observer(self.truth.observer, len(time))
        return carrier(self.drive.observer, time)

    def derivatives(self, errors: Mapping[str, float], names: list[str]) -> Array:
        """``(p, m, rows)`` of what is expected with respect to each of the errors, by central differences."""
        # Between two rows the derivative would have the noise of the reference that the residual has. Over a whole
        # interval to either side, what the two have of the same rows cancels.
        steps = {**_STEPS, "time_offset": self.noise.reach_s}
        columns = []
        for name in names:
            if name.startswith("bias_"):
                column = np.zeros_like(self.log.measurement)
                column[self.components.index(name.removeprefix("bias_"))] = 1.0
            else:
                step = steps[name]
                above, below = ({**errors, name: errors.get(name, 0.0) + sign * step} for sign in (1, -1))
                column = difference(self.expected(above), self.expected(below), self.config.angular) / (2 * step)
            columns.append(column)
        return np.stack(columns)

    def reference_variance(self, errors: Mapping[str, float]) -> Array:
        """``(m, rows)`` what the noise of the reference adds to the variance of a residual."""
        derivatives = self.derivatives(errors, ["px", "py", "vx", "vy", "mount_yaw"])
        variance = self.noise.variance(self.log.time + errors.get("time_offset", 0.0), self.log.object)
        return np.asarray(np.einsum("pmr,pr->mr", derivatives**2, variance))

    def _mount(self, errors: Mapping[str, float]) -> Mount:
        mount = self.config.mount
        return mount.model_copy(
            update={
                "x_m": mount.x_m + errors.get("mount_x", 0.0),
                "y_m": mount.y_m + errors.get("mount_y", 0.0),
                "yaw_deg": mount.yaw_deg + float(np.rad2deg(errors.get("mount_yaw", 0.0))),
            }
        )


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
        finite = np.isfinite(expected[i])
        measured, wanted, circular = log.measurement[i, finite], expected[i, finite], i in log.config.angular
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
