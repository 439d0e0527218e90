"""The measurements of one sensor of a log beside what it should have read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from trackbench.base.types import Array, Indices, Observer
from trackbench.base.units import difference
from trackbench.models.sensors import Mount, Radar, Sensor
from trackbench.sensing.view import sensor_motion
from trackbench.truth.recorded import Drive
from trackbench.truth.recorded.assemble import carrier, fixed
from trackbench.truth.recorded.drive import Log
from trackbench.truth.sources import RecordingTruth

#: The errors of time and mounting that every sensor may have, with their units.
POSE_ERRORS = {"time_offset": "s", "mount_yaw": "rad", "mount_x": "m", "mount_y": "m"}


@dataclass(frozen=True)
class SensorLog:
    """One sensor's part of a log, one row a detection within the time of the truth."""

    name: str
    config: Sensor
    log: Log
    drive: Drive
    truth: RecordingTruth
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

    def with_factor(self, component: int, factor: float) -> SensorLog:
        """The log with one component in another unit."""
        factors = self.factors.copy()
        factors[component] *= factor
        return replace(self, factors=factors)

    def rows(self, kept: Indices) -> SensorLog:
        """The log of some of its rows."""
        log = self.log
        chosen = log._replace(time=log.time[kept], object=log.object[kept], measurement=log.measurement[:, kept])
        return replace(self, log=chosen)

    def expected(self, errors: Mapping[str, float]) -> Array:
        """``(m, rows)`` the noise-free measurement, were the sensor's errors these; NaN outside the truth."""
        time = self.log.time + errors.get("time_offset", 0.0)
        target = self.target(time, self.log.object)
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
        found = np.full((4, len(time)), np.nan)
        for number, motion in enumerate(self.drive.motions.values()):
            first, last = self.drive.span(number)
            own = (owner == number) & (time >= first) & (time <= last)
            for row, values in enumerate((motion.px, motion.py, motion.vx, motion.vy)):
                found[row, own] = np.interp(time[own], motion.time, values)
        return found

    def observer(self, time: Array) -> Observer:
        """What carries the sensor."""
        if self.drive.observer is None:
            return fixed(self.truth.observer, len(time))
        return carrier(self.drive.observer, time)

    def derivatives(self, errors: Mapping[str, float], names: list[str]) -> Array:
        """``(p, m, rows)`` of what is expected with respect to each of the errors, by central differences."""
        # Shorter than any period of a sensor, and long enough for truth that is written to the millimetre.
        steps = {"time_offset": 0.01, "mount_yaw": 1e-4, "mount_x": 1e-3, "mount_y": 1e-3}
        found = []
        for name in names:
            if name.startswith("bias_"):
                column = np.zeros_like(self.log.measurement)
                column[self.components.index(name.removeprefix("bias_"))] = 1.0
            else:
                step = steps[name]
                above, below = ({**errors, name: errors.get(name, 0.0) + sign * step} for sign in (1, -1))
                column = difference(self.expected(above), self.expected(below), self.config.angular) / (2 * step)
            found.append(column)
        return np.stack(found)

    def _mount(self, errors: Mapping[str, float]) -> Mount:
        mount = self.config.mount
        return mount.model_copy(
            update={
                "x_m": mount.x_m + errors.get("mount_x", 0.0),
                "y_m": mount.y_m + errors.get("mount_y", 0.0),
                "yaw_deg": mount.yaw_deg + float(np.rad2deg(errors.get("mount_yaw", 0.0))),
            }
        )
