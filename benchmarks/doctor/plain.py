"""What the plain trackers share: third-party style code in plain NumPy for one target, nothing of trackbench in it.

Each piece that somebody could get wrong is a method of its own, so that a fault is one method replaced.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray
Belief = tuple[Array, Array]

MIN_RANGE = 1e-6


class Track(NamedTuple):
    """The state between two scans; without a mean until the track has started."""

    time: float
    mean: Array | None = None
    covariance: Array | None = None
    first: tuple[float, Array, Array] | None = None
    """Time, position and its covariance of the first measurement, while the second is awaited."""


def wrap(angle: Any) -> Any:
    """To [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def symmetric(P: Array) -> Array:
    return (P + P.T) / 2


def rotation(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


class PlainTracker:
    """Start, timing and sensors; a filter adds ``predict`` and ``update`` of its own state."""

    def __init__(self, start: str = "first_measurement", velocity_sigma: float = 20.0, acceleration_sigma: float = 3.0):
        self.start = start
        self.velocity_sigma = velocity_sigma
        self.acceleration_sigma = acceleration_sigma

    def step(self, state: Track | None, scan: Any) -> tuple[Any, Belief | None]:
        track = Track(scan.time) if state is None else state
        track = self.begin(track, scan) if track.mean is None else self.advance(track, scan)
        return track, None if track.mean is None else self.output(track.mean, track.covariance)

    def advance(self, track: Track, scan: Any) -> Track:
        """A track that has started, predicted to the scan and corrected by its measurement."""
        x, P = self.predict(track.mean, track.covariance, scan.time - track.time)
        if self.usable(scan):
            x, P = self.update(x, P, scan)
        return Track(scan.time, x, P)

    def usable(self, scan: Any) -> bool:
        return bool(scan.valid)

    # How a track starts, in the Cartesian state px, py, vx, vy.

    def begin(self, track: Track, scan: Any) -> Track:
        if not scan.valid:
            return track._replace(time=scan.time)
        position, noise = self.first_position(scan)
        if self.start == "first_measurement":
            return Track(scan.time, *self.from_cartesian(*self.one_measurement(position, noise, scan)))
        if track.first is None:
            return Track(scan.time, first=(scan.time, position, noise))
        elapsed = scan.time - track.first[0]
        if not self.differs(elapsed):
            return track._replace(time=scan.time)
        return Track(
            scan.time, *self.from_cartesian(*self.two_measurements(track.first[1:], (position, noise), elapsed))
        )

    def differs(self, elapsed: float) -> bool:
        """Whether two measurements are far enough apart in time for a velocity."""
        return elapsed > 0

    def first_position(self, scan: Any) -> Belief:
        return self.position(scan)

    def first_velocity(self, scan: Any) -> Array:
        return np.zeros(2)

    def one_measurement(self, position: Array, noise: Array, scan: Any) -> Belief:
        P = np.zeros((4, 4))
        P[:2, :2] = noise
        P[2, 2] = P[3, 3] = self.velocity_sigma**2
        return np.concatenate([position, self.first_velocity(scan)]), P

    def two_measurements(self, first: Belief, second: Belief, dt: float) -> Belief:
        """Two-point differencing (Bar-Shalom, Li and Kirubarajan 2001, section 5.5.3)."""
        (a, Ra), (b, Rb) = first, second
        P = np.block([[Rb, Rb / dt], [Rb / dt, (Ra + Rb) / dt**2]])
        return np.concatenate([b, (b - a) / dt]), P

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        return x, P

    def output(self, x: Array, P: Array) -> Belief:
        """px, py, vx, vy in the fixed frame, with covariance."""
        return x, P

    # The sensors, seen from the Cartesian state.

    def position(self, scan: Any) -> Belief:
        """The position in the fixed frame that a measurement gives, and its covariance to first order."""
        R = self.noise(scan)
        if scan.kind == "radar":
            r, azimuth = scan.measurement[:2]
            local = r * np.array([np.cos(azimuth), np.sin(azimuth)])
            J = rotation(azimuth + scan.sensor_pose[2]) @ np.diag([1.0, r])
        else:
            local, J = scan.measurement, rotation(scan.sensor_pose[2])
        return scan.sensor_pose[:2] + rotation(scan.sensor_pose[2]) @ local, J @ R[:2, :2] @ J.T

    def noise(self, scan: Any) -> Array:
        return scan.noise_covariance

    def predicted_measurement(self, target: Array, scan: Any) -> Array:
        dx, dy = target[:2] - scan.sensor_pose[:2]
        x, y = rotation(scan.sensor_pose[2]).T @ [dx, dy]
        if scan.kind == "lidar":
            return np.array([x, y])
        return np.array([self.range(dx, dy), self.azimuth(x, y), self.range_rate(target, scan)])

    def range(self, dx: float, dy: float) -> float:
        return max(np.hypot(dx, dy), MIN_RANGE)

    def azimuth(self, x: float, y: float) -> float:
        """From the position in the sensor's frame."""
        return np.arctan2(y, x)

    def range_rate(self, target: Array, scan: Any) -> float:
        dx, dy = target[:2] - scan.sensor_pose[:2]
        vx, vy = target[2:] - scan.sensor_velocity
        return (dx * vx + dy * vy) / self.range(dx, dy)

    def residual(self, kind: str, a: Array, b: Array) -> Array:
        """Difference of two measurements."""
        d = a - b
        if kind == "radar":
            d[1] = wrap(d[1])
        return d

    def innovation(self, scan: Any, predicted: Array) -> Array:
        return self.residual(scan.kind, scan.measurement, predicted)

    # The Kalman correction.

    def corrected(self, x: Array, P: Array, K: Array, y: Array, S: Array) -> Belief:
        return self.corrected_mean(x, K, y), self.corrected_covariance(P, K, S)

    def corrected_mean(self, x: Array, K: Array, y: Array) -> Array:
        return x + K @ y

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        return symmetric(P - K @ S @ K.T)
