"""The measurements of one sensor of a log, the measurements that its truth predicts, and checks that need no fit.

The reference is the recorded truth, which is noisy itself; its velocities are compared with its positions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from trackbench.base.types import Array, Indices, Observer
from trackbench.base.units import difference, wrap_angle
from trackbench.models.sensors import Mount, Radar, Sensor
from trackbench.sensing.view import sensor_motion
from trackbench.truth.config.columns import CARTESIAN, COMPONENT_QUANTITIES, UNITS, Column, column_in
from trackbench.truth.frames import fixed_observer
from trackbench.truth.recorded import Drive
from trackbench.truth.recorded.drive import Log, Motion, RowOrder, carrier
from trackbench.truth.recorded.reference import moved_ahead
from trackbench.truth.recorded.robust import THIRD, body_sigmas, travelled, white_sigma
from trackbench.truth.sources import RecordingTruth

#: N times the relative variance of the mean square of N third differences of white noise: twice the sum of their
#: squared autocorrelation.
_FREEDOM = 2 * float((np.correlate(THIRD, THIRD, "full") ** 2).sum()) / float((THIRD**2).sum()) ** 2


@dataclass(frozen=True)
class ReferenceNoise:
    """Noise of the reference (the recorded truth), independent from row to row."""

    drive: Drive
    objects: tuple[tuple[float, float], ...]
    """For each object the standard deviations of position, m, and velocity, m/s."""
    observer: tuple[float, float, float]
    """Standard deviation of position, velocity and heading of the sensors' carrier, m, m/s and rad."""
    reach_s: float
    """Time to either side over which derivatives with respect to time are differences."""
    uncertainty: float
    """Relative standard deviation of the estimated variances."""

    def variance(self, time: Array, owner: Indices) -> Array:
        """Return variances ``(5, rows)`` of px, py, vx, vy of objects relative to the observer, and of its heading."""
        variance = np.zeros((5, len(time)))
        for number, (motion, sigmas) in enumerate(zip(self.drive.motions.values(), self.objects, strict=True)):
            is_own = owner == number
            share = _interpolation_variance(motion.time, time[is_own])
            for row, sigma in enumerate(np.repeat(sigmas, 2).tolist()):
                variance[row, is_own] = sigma**2 * share
        if self.drive.observer is not None:
            share = _interpolation_variance(self.drive.observer.time, time)
            position, velocity, heading = self.observer
            variance += np.square([position, position, velocity, velocity, heading])[:, None] * share
        return variance


def reference_noise(drive: Drive) -> ReferenceNoise:
    """Estimate the noise of the reference (the recorded truth) from its rows."""
    objects = tuple(body_sigmas(motion) for motion in drive.motions.values())
    carried, observer = drive.observer, (0.0, 0.0, 0.0)
    if carried is not None:
        assert carried.heading is not None
        observer = (*body_sigmas(carried), white_sigma(np.unwrap(carried.heading)[None]))
    groups = [list(drive.motions.values()), [carried] if carried is not None else []]
    intervals = [np.concatenate([np.diff(m.time) for m in group]) for group in groups if group]
    usual = max(SHORTEST_S, *(float(np.median(times)) if len(times) else 0.0 for times in intervals))
    noise = max(observer[0], *(position for position, _ in objects)) / (np.sqrt(2) * RATE_NOISE_MPS)
    fewest = max(1, min(len(m.time) for m in drive.motions.values()))
    return ReferenceNoise(
        drive, objects, observer, max(usual, min(noise, LONGEST_S)), float(np.sqrt(_FREEDOM / (2 * fewest)))
    )


#: Limits of the time over which derivatives with respect to time are differences. It is at least one row and
#: ``SHORTEST_S``, since truth may be written to the millimetre. It is long enough that position noise adds at most
#: ``RATE_NOISE_MPS`` to the speed, and at most ``LONGEST_S``, in which a vehicle moves evenly.
SHORTEST_S, RATE_NOISE_MPS, LONGEST_S = 0.01, 0.15, 0.5


def _interpolation_variance(rows: Array, time: Array) -> Array:
    """Return the variance of a linear interpolation between rows of unit variance: 1 at a row, 1/2 in the middle."""
    if len(rows) < 2:
        return np.ones_like(time)
    after = np.clip(np.searchsorted(rows, time, side="right"), 1, len(rows) - 1)
    between = np.clip((time - rows[after - 1]) / (rows[after] - rows[after - 1]), 0.0, 1.0)
    return np.asarray((1 - between) ** 2 + between**2)


#: Length of the windows in which velocity and displacement are compared, s.
WINDOW = 0.5
#: Largest difference that is no fault, m/s: the range-rate noise of a good automotive radar.
TOLERANCE_MPS = 0.1
#: Windows are joined until position noise makes a difference below this, m/s. At half of the tolerance, one sound log
#: in a thousand was still found at fault; at this value, one in 100 000.
NOISE_MPS = 0.4 * TOLERANCE_MPS
#: Largest relative distance of a velocity's scale from another unit's at which that unit is assumed.
NEAR = 0.03
#: Fewest windows of motion by which an object's velocity is checked.
FEWEST = 4


@dataclass(frozen=True)
class VelocityCheck:
    """Comparison of a body's velocity as the truth states it with the velocity of its positions (displacement)."""

    name: str
    difference: float
    """Median length of the stated velocity minus the displacement's velocity, m/s."""
    scale: float
    """Ratio of the displacement's velocity to the stated velocity."""
    unit: str | None
    """Other unit in which the stated speed would fit; None where no other unit fits."""

    @property
    def contradicts(self) -> bool:
        """Whether the stated velocity contradicts the displacement."""
        return self.difference > TOLERANCE_MPS


def velocity_check(name: str, motion: Motion, stated_unit: str) -> VelocityCheck | None:
    """Compare the velocity of a body with its displacement; None where the recording is too short."""
    # Rows that bound windows of at least the wanted length.
    rows = [0]
    for row, instant in enumerate(motion.time.tolist()):
        if instant - motion.time[rows[-1]] >= WINDOW * (1 - 1e-9):
            rows.append(row)
    edges = np.array(rows, dtype=np.intp)
    noise = body_sigmas(motion)[0]
    # Median length of a difference of two noisy positions, over the difference allowed in the velocity.
    longest = np.sqrt(2) * np.sqrt(2 * np.log(2)) * noise / NOISE_MPS
    wide = edges[:: max(1, int(np.ceil(longest / WINDOW)))]
    if len(wide) <= FEWEST:
        return None
    position, by_velocity = np.stack([motion.px, motion.py]), travelled(motion)
    dt = np.diff(motion.time[edges])
    moved, stated = (np.diff(path[:, edges], axis=1) / dt for path in (position, by_velocity))
    usual = float(np.median(np.hypot(*np.diff((position - by_velocity)[:, wide], axis=1)) / np.diff(motion.time[wide])))
    square = float((stated**2).sum())
    scale = float((moved * stated).sum() / square) if square > 0 else 1.0
    fits = None
    for unit, factor in UNITS["speed"].items():
        if unit != stated_unit and abs(scale * UNITS["speed"][stated_unit] / factor - 1) < NEAR:
            fits = unit
    return VelocityCheck(name, usual, scale, fits)


#: Errors of time and mounting that every sensor may have, with their units.
POSE_ERRORS = {"time_offset": "s", "mount_yaw": "rad", "mount_x": "m", "mount_y": "m"}
#: Name of the error that the measured point of a body lies ahead of the truth's point, along the heading, m.
BODY_POINT = "body_point"
#: Speed below which a body without a stated heading keeps its last course, m/s.
SLOW_MPS = 0.5
#: Steps of central differences; the step of a time offset depends on the rows of the reference.
_STEPS = {"mount_yaw": 1e-4, **dict.fromkeys((BODY_POINT, "mount_x", "mount_y", "px", "py", "vx", "vy"), 1e-3)}


@dataclass(frozen=True)
class SensorLog:
    """Measurements of one sensor in a log, one row for each detection within the time of the truth."""

    name: str
    config: Sensor
    log: Log
    drive: Drive
    truth: RecordingTruth
    noise: ReferenceNoise
    """Noise of the reference, which is the recorded truth."""
    factors: Array
    """Factor on each component, ``(m,)``; it differs from 1 where the unit was found to be wrong."""

    @property
    def components(self) -> tuple[str, ...]:
        return self.config.components

    @property
    def columns(self) -> dict[str, Column]:
        """Columns of the log by component; empty for a format with fixed columns."""
        entry = self.truth.measurements.get(self.name)
        return {} if entry is None else entry.columns(self.components, self.config.units)

    @property
    def errors(self) -> dict[str, str]:
        """Errors that the audit looks for, with their units: time, mounting, biases and the measured point.

        Azimuth and positions have no bias of their own, since no log can tell it from a turned or displaced mount.
        """
        units = zip(self.components, self.config.units, strict=True)
        biases = {f"bias_{name}": unit for name, unit in units if name not in (*CARTESIAN, "azimuth")}
        return {**POSE_ERRORS, **biases, BODY_POINT: "m"}

    @property
    def measurement(self) -> Array:
        """Measurements in the units that were found to be right, ``(m, rows)``."""
        return self.log.measurement * self.factors[:, None]

    def rows(self, numbers: Indices) -> SensorLog:
        """Return the log with only the rows that have the indices ``numbers``."""
        log = self.log
        time, owner, measurement = log.time[numbers], log.object[numbers], log.measurement[:, numbers]
        return replace(self, log=log._replace(time=time, object=owner, measurement=measurement))

    def expected(self, errors: Mapping[str, float]) -> Array:
        """Return the noise-free measurements ``(m, rows)`` of a sensor with ``errors``; NaN outside the truth's time.

        Besides sensor errors, ``errors`` can have "px", "py", "vx" and "vy": errors of the truth of all objects.
        """
        time = self.log.time + errors.get("time_offset", 0.0)
        target = self.target(time, self.log.object, errors.get(BODY_POINT, 0.0))
        target += np.array([errors.get(name, 0.0) for name in ("px", "py", "vx", "vy")])[:, None]
        motion = sensor_motion(self.observer(time), self._mount(errors))
        seen = self.config.measure(target, motion.pose, motion.velocity)
        biases = np.array([errors.get(f"bias_{name}", 0.0) for name in self.components])
        return np.asarray(seen + biases[:, None])

    def residual(self, errors: Mapping[str, float]) -> Array:
        """Return measurement minus expected measurement ``(m, rows)``, angles wrapped."""
        return difference(self.measurement, self.expected(errors), self.config.angular)

    def polar(self, time: Array, owner: Indices, errors: Mapping[str, float]) -> Array:
        """Return true range and azimuth ``(2, n)`` of objects from the sensor, at times of the sensor's clock."""
        at = time + errors.get("time_offset", 0.0)
        motion = sensor_motion(self.observer(at), self._mount(errors))
        return np.asarray(Radar.measure(self.target(at, owner), motion.pose, motion.velocity)[:2])

    def target(self, time: Array, owner: Indices, ahead: float = 0.0) -> Array:
        """Return the true px, py, vx, vy of objects in the fixed frame, ``(4, n)``; NaN outside the truth's time.

        Args:
            time: times ``(n,)``, s.
            owner: index of the object at each time, ``(n,)``.
            ahead: distance of the returned point in front of the truth's point, m.
        """
        state = np.full((4, len(time)), np.nan)
        for number, motion in enumerate(self.drive.motions.values()):
            motion = _moved_along_course(motion, ahead)
            first, last = self.drive.span(number)
            is_own = (owner == number) & (time >= first) & (time <= last)
            for row, values in enumerate((motion.px, motion.py, motion.vx, motion.vy)):
                state[row, is_own] = np.interp(time[is_own], motion.time, values)
        return state

    def observer(self, time: Array) -> Observer:
        """Return the motion of the sensor's carrier at times ``time``, s."""
        if self.drive.observer is None:
            return fixed_observer(self.truth.observer, len(time))
        return carrier(self.drive.observer, time)

    def derivatives(self, errors: Mapping[str, float], names: list[str]) -> Array:
        """Return derivatives ``(p, m, rows)`` of the expected measurement with respect to the errors ``names``."""
        # Between two rows the derivative by time would have the same reference noise as the residual. Over a whole
        # interval to either side, the noise of common rows cancels.
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
        """Return the variance ``(m, rows)`` that noise of the reference adds to the residual."""
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


def _moved_along_course(motion: Motion, ahead: float) -> Motion:
    # A body without a heading that never moves has no front, so that its point cannot be moved ahead.
    heading, moves = motion.heading, np.hypot(motion.vx, motion.vy) > SLOW_MPS
    if ahead and heading is None and moves.any():
        course = np.unwrap(np.arctan2(motion.vy, motion.vx)[moves])
        heading = np.interp(motion.time, motion.time[moves], course)
    return motion if heading is None or not ahead else moved_ahead(motion, heading, ahead)


@dataclass(frozen=True)
class Clock:
    """Statistics of the time stamps of a sensor's rows, or of the truth's rows."""

    name: str
    order: RowOrder
    outside: int
    """Number of rows outside the time of the truth."""
    usual_s: float | None
    """Median interval between successive different time stamps; None with a single time stamp."""
    longest_gap_s: float


def clock_of(name: str, time: Array, order: RowOrder, outside: int = 0) -> Clock:
    """Return statistics of the time stamps ``(rows,)``, s, of a sensor or the truth, with the order of the rows."""
    intervals = np.diff(np.unique(time))
    if not len(intervals):
        return Clock(name, order, outside, None, 0.0)
    return Clock(name, order, outside, float(np.median(intervals)), float(intervals.max()))


#: Factor by which another unit must reduce the spread of the residuals.
CLEARLY = 3.0


@dataclass(frozen=True)
class WrongUnit:
    """Component of a measurement that fits the truth in another unit or with the other sign."""

    component: str
    stated: str
    fits: str
    """Unit in which the component fits the truth."""
    turned: bool
    """Whether the component fits the truth with the opposite sign."""
    factor: float
    """Factor by which the measurement as read must be multiplied to fit the truth."""
    spread: tuple[float, float]
    """Median deviation of the residuals, SI units and rad, by the stated unit and by the fitting one."""


def wrong_units(log: SensorLog) -> Iterator[WrongUnit]:
    """Yield the components whose residuals get clearly smaller in another unit."""
    expected = log.expected({})
    for i, (name, unit) in enumerate(zip(log.components, log.config.units, strict=True)):
        quantity = COMPONENT_QUANTITIES.get(unit)
        if quantity is None:
            continue
        finite = np.isfinite(expected[i])
        measured, true_values, circular = log.measurement[i, finite], expected[i, finite], i in log.config.angular
        stated = log.columns.get(name, column_in(name, quantity)).unit
        as_read = _spread(measured, true_values, circular)
        choices = {
            (other, turned): UNITS[quantity][other] / UNITS[quantity][stated] * (-1.0 if turned else 1.0)
            for other in UNITS[quantity]
            for turned in (False, True)
        }
        spreads = {choice: _spread(factor * measured, true_values, circular) for choice, factor in choices.items()}
        best = min(spreads, key=spreads.__getitem__)
        # A factor that makes the measurement nearly zero fits as well as the truth varies.
        zero_spread = _spread(np.zeros_like(true_values), true_values, circular)
        if best != (stated, False) and CLEARLY * spreads[best] < min(as_read, zero_spread):
            yield WrongUnit(name, stated, best[0], best[1], choices[best], (as_read, spreads[best]))


def _spread(measured: Array, true_values: Array, circular: bool) -> float:
    """Return the median distance of the residuals from their median."""
    residual = measured - true_values
    if circular:
        middle = np.angle(np.mean(np.exp(1j * residual)))
        residual = wrap_angle(residual - middle)
    return float(np.median(np.abs(residual - np.median(residual)))) if len(residual) else 0.0
