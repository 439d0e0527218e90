"""The measurements of one sensor of a log beside what it should have read, and checks that need no fit.

The reference itself is noisy; its velocities are held against its positions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from trackbench.base.types import Array, Indices, Observer
from trackbench.base.units import difference, wrap_angle
from trackbench.models.sensors import Mount, Radar, Sensor
from trackbench.sensing.view import sensor_motion
from trackbench.truth.config.columns import CARTESIAN, COMPONENT_QUANTITIES, UNITS, MeasurementColumns
from trackbench.truth.frames import fixed_observer
from trackbench.truth.recorded import Drive
from trackbench.truth.recorded.drive import Log, Motion, RowOrder, carrier
from trackbench.truth.recorded.reference import moved_ahead
from trackbench.truth.recorded.robust import THIRD, body_sigmas, travelled, white_sigma
from trackbench.truth.sources import RecordingTruth

#: Variance of the mean square of N third differences of white noise, times N: twice the sum of the squares of their
#: autocorrelation.
_FREEDOM = 2 * float((np.correlate(THIRD, THIRD, "full") ** 2).sum()) / float((THIRD**2).sum()) ** 2


@dataclass(frozen=True)
class ReferenceNoise:
    """Noise of the rows of the reference, independent from row to row."""

    drive: Drive
    objects: tuple[tuple[float, float], ...]
    """Standard deviation of position and velocity of each object, m and m/s."""
    observer: tuple[float, float, float]
    """Standard deviation of position, velocity and heading of what carries the sensors, m, m/s and rad."""
    reach_s: float
    """Derivatives with respect to time are differences over this much to either side."""
    uncertainty: float
    """Standard deviation of the variances of an object, as a share of them."""

    def variance(self, time: Array, owner: Indices) -> Array:
        """``(5, rows)`` of px, py, vx, vy of objects relative to the observer, and of its heading, at some times."""
        variance = np.zeros((5, len(time)))
        for number, (motion, sigmas) in enumerate(zip(self.drive.motions.values(), self.objects, strict=True)):
            own = owner == number
            share = _interpolated(motion.time, time[own])
            for row, sigma in enumerate(np.repeat(sigmas, 2).tolist()):
                variance[row, own] = sigma**2 * share
        if self.drive.observer is not None:
            share = _interpolated(self.drive.observer.time, time)
            position, velocity, heading = self.observer
            variance += np.square([position, position, velocity, velocity, heading])[:, None] * share
        return variance


def reference_noise(drive: Drive) -> ReferenceNoise:
    """The noise of a reference, from its rows."""
    objects = tuple(body_sigmas(motion) for motion in drive.motions.values())
    carried, observer = drive.observer, (0.0, 0.0, 0.0)
    if carried is not None:
        assert carried.heading is not None
        observer = (*body_sigmas(carried), white_sigma(np.unwrap(carried.heading)[None]))
    groups = [list(drive.motions.values()), [carried] if carried is not None else []]
    intervals = [np.concatenate([np.diff(m.time) for m in group]) for group in groups if group]
    usual = max(SHORTEST_S, *(float(np.median(each)) if len(each) else 0.0 for each in intervals))
    noise = max(observer[0], *(position for position, _ in objects)) / (np.sqrt(2) * RATE_NOISE_MPS)
    fewest = max(1, min(len(m.time) for m in drive.motions.values()))
    return ReferenceNoise(
        drive, objects, observer, max(usual, min(noise, LONGEST_S)), float(np.sqrt(_FREEDOM / (2 * fewest)))
    )


#: A derivative with respect to time is a difference over at least one row to either side, and no less than this, for
#: truth that is written to the millimetre; and over so much that the noise of the positions makes no more of the speed,
#: but no longer than a vehicle moves evenly.
SHORTEST_S, RATE_NOISE_MPS, LONGEST_S = 0.01, 0.15, 0.5


def _interpolated(rows: Array, time: Array) -> Array:
    """Variance of a value interpolated linearly between rows of unit variance: one at a row, a half in the middle."""
    if len(rows) < 2:
        return np.ones_like(time)
    after = np.clip(np.searchsorted(rows, time, side="right"), 1, len(rows) - 1)
    between = np.clip((time - rows[after - 1]) / (rows[after] - rows[after - 1]), 0.0, 1.0)
    return np.asarray((1 - between) ** 2 + between**2)


#: The velocity is compared with the displacement over windows of this length, s.
WINDOW = 0.5
#: The largest difference that passes, m/s: the range-rate noise of a good automotive radar.
TOLERANCE_MPS = 0.1
#: As many windows are taken together as bring the difference that the noise of the positions makes below this, m/s. At
#: half of the tolerance the median of few windows still passed it in one of a thousand logs; so in one of 100 000.
NOISE_MPS = 0.4 * TOLERANCE_MPS
#: A scale this near to that of another unit is taken for it.
NEAR = 0.03
#: Windows of motion without which nothing is said of an object.
FEWEST = 4


@dataclass(frozen=True)
class VelocityCheck:
    """The velocity of one body of the truth beside its displacement."""

    name: str
    difference: float
    """Median length of the difference of the two velocities, m/s, over windows that the noise makes longer."""
    scale: float
    """The displacement's velocity is this many times the stated one."""
    unit: str | None
    """The unit in which the stated speed would fit, if it is another one."""

    @property
    def contradicts(self) -> bool:
        """Whether the velocity cannot be that of the motion."""
        return self.difference > TOLERANCE_MPS


def velocity_check(name: str, motion: Motion, stated_unit: str) -> VelocityCheck | None:
    """Compare the velocity of a body with its displacement; None where it is too short."""
    # Rows between which windows of at least the wanted length lie.
    rows = [0]
    for row, instant in enumerate(motion.time.tolist()):
        if instant - motion.time[rows[-1]] >= WINDOW * (1 - 1e-9):
            rows.append(row)
    edges = np.array(rows, dtype=np.intp)
    noise = body_sigmas(motion)[0]
    # The median length of a difference of two positions with this noise, over what it may make of the velocity.
    longest = np.sqrt(2) * np.sqrt(2 * np.log(2)) * noise / NOISE_MPS
    wide = edges[:: max(1, int(np.ceil(longest / WINDOW)))]
    if len(wide) <= FEWEST:
        return None
    position, by_velocity = np.stack([motion.px, motion.py]), travelled(motion)
    dt = np.diff(motion.time[edges])
    moved, stated = (np.diff(place[:, edges], axis=1) / dt for place in (position, by_velocity))
    usual = float(np.median(np.hypot(*np.diff((position - by_velocity)[:, wide], axis=1)) / np.diff(motion.time[wide])))
    square = float((stated**2).sum())
    scale = float((moved * stated).sum() / square) if square > 0 else 1.0
    fits = None
    for unit, factor in UNITS["speed"].items():
        if unit != stated_unit and abs(scale * UNITS["speed"][stated_unit] / factor - 1) < NEAR:
            fits = unit
    return VelocityCheck(name, usual, scale, fits)


#: The errors of time and mounting that every sensor may have, with their units.
POSE_ERRORS = {"time_offset": "s", "mount_yaw": "rad", "mount_x": "m", "mount_y": "m"}
#: How far the measured point of a body is ahead of the truth's, along its heading, m.
BODY_POINT = "body_point"
#: A slower body without a stated heading keeps the course that it had, m/s.
SLOW_MPS = 0.5
#: Steps of central differences; a time offset is differentiated over the rows of the reference.
_STEPS = {"mount_yaw": 1e-4, **dict.fromkeys((BODY_POINT, "mount_x", "mount_y", "px", "py", "vx", "vy"), 1e-3)}


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
        """All errors that are looked for, with their units: of time, mounting, components and the measured point.

        A bias of the azimuth is in any log the same as a turned mount, and one of a position as a mount elsewhere.
        """
        units = zip(self.components, self.config.units, strict=True)
        biases = {f"bias_{name}": unit for name, unit in units if name not in (*CARTESIAN, "azimuth")}
        return {**POSE_ERRORS, **biases, BODY_POINT: "m"}

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
        target = self.target(time, self.log.object, errors.get(BODY_POINT, 0.0))
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

    def target(self, time: Array, owner: Indices, ahead: float = 0.0) -> Array:
        """Return px, py, vx, vy of objects, ``(4, n)``; NaN where their truth, or the observer's, is not known.

        Args:
            time: ``(n,)`` s.
            owner: ``(n,)`` number of the object.
            ahead: m, how far in front of the truth's point the state is taken.
        """
        state = np.full((4, len(time)), np.nan)
        for number, motion in enumerate(self.drive.motions.values()):
            motion = _moved_along_course(motion, ahead)
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


def _moved_along_course(motion: Motion, ahead: float) -> Motion:
    """A body without a heading that never moves has no front, and stays."""
    heading, moves = motion.heading, np.hypot(motion.vx, motion.vy) > SLOW_MPS
    if ahead and heading is None and moves.any():
        course = np.unwrap(np.arctan2(motion.vy, motion.vx)[moves])
        heading = np.interp(motion.time, motion.time[moves], course)
    return motion if heading is None or not ahead else moved_ahead(motion, heading, ahead)


@dataclass(frozen=True)
class Clock:
    """The times of one sensor's rows, or of the truth's."""

    name: str
    order: RowOrder
    outside: int
    """Rows outside the time of the truth."""
    usual_s: float | None
    """Median interval between different times."""
    longest_gap_s: float


def clock_of(name: str, time: Array, order: RowOrder, outside: int = 0) -> Clock:
    """Return what there is to say of some times.

    Args:
        name: of the sensor, or "truth".
        time: ``(rows,)`` s.
        order: in which the rows stand in the file.
        outside: rows outside the time of the truth.
    """
    intervals = np.diff(np.unique(time))
    if not len(intervals):
        return Clock(name, order, outside, None, 0.0)
    return Clock(name, order, outside, float(np.median(intervals)), float(intervals.max()))


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
