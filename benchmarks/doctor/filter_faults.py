"""Faults in the start, the noise and the update of a plain tracker, as methods that override the correct ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import Array, Belief, PlainTracker, Track


class CertainStart:
    """A first covariance that is tiny in every component."""

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        x, P = super().from_cartesian(x, P)
        return x, 1e-4 * np.eye(len(x))


class PolarStart:
    """Range and azimuth of the first radar measurement as px and py."""

    def first_position(self, scan: Any) -> Belief:
        if scan.kind == "radar":
            return scan.measurement[:2].copy(), np.eye(2)
        return super().first_position(scan)


class PolarStartWithRate(PolarStart):
    """Besides, the range rate as vx."""

    def first_velocity(self, scan: Any) -> Array:
        return np.array([scan.measurement[2], 0.0]) if scan.kind == "radar" else super().first_velocity(scan)


class ArctanCourse:
    """The first course by arctan(vy / vx): backwards where vx is negative."""

    def course(self, vx: float, vy: float) -> float:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.nan_to_num(np.arctan(np.divide(vy, vx)))


class UnsymmetricUpdate:
    """The upper triangle of each corrected covariance off by a thousandth."""

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        P = super().corrected_covariance(P, K, S)
        return P * (1 + np.triu(np.full(P.shape, 1e-3), 1))


class OneSidedNoise:
    """Process noise without the entries below its diagonal, and a correction that does not symmetrise."""

    def process_noise(self, x: Array, dt: float) -> Array:
        return np.triu(super().process_noise(x, dt))

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        return P - K @ S @ K.T


class EntryAdded:
    """Process noise with an entry on one side of its diagonal that belongs on both, symmetrised by no correction."""

    def process_noise(self, x: Array, dt: float) -> Array:
        Q = super().process_noise(x, dt)
        Q[0, 1] += 0.5 * np.sqrt(Q[0, 0] * Q[1, 1])
        return Q

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        return P - K @ S @ K.T


class NoiseTooCorrelated:
    """Process noise whose position and velocity have twice the covariance that their variances allow."""

    def process_noise(self, x: Array, dt: float) -> Array:
        Q = super().process_noise(x, dt)
        Q[0, 2] = Q[2, 0] = 2 * Q[0, 2]
        return Q


class SubtractsTooMuch:
    """Subtracts half as much again from the covariance as the update should."""

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        return super().corrected_covariance(P, np.sqrt(1.5) * K, S)


class CovarianceUpdatedTwice:
    """Joseph's form is applied twice, and the mean moved once."""

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        H = np.linalg.solve(P, K @ S).T
        kept, R = np.eye(len(P)) - K @ H, S - H @ P @ H.T
        once = super().corrected_covariance(P, K, S)
        return kept @ once @ kept.T + K @ R @ K.T


class OtherGainInCovariance:
    """Joseph's form with 1.6 times the gain that moves the mean: it adds 0.6^2 K S K^T."""

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        return super().corrected_covariance(P, K, S) + 0.6**2 * K @ S @ K.T


class MeanMovedFarther:
    """The mean is moved by 1.5 times the gain that the covariance is updated with."""

    def corrected_mean(self, x: Array, K: Array, y: Array) -> Array:
        return super().corrected_mean(x, 1.5 * K, y)


class MissedRaises:
    """Reads a measurement without a look whether it is there."""

    def usable(self, scan: Any) -> bool:
        if not scan.valid:
            raise ValueError("nothing to read")
        return True


class MeanNotMoved:
    """A sensor's update reduces the covariance and leaves the mean."""

    kind: str

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        later, P = super().update(x, P, scan)
        return (x if scan.kind == self.kind else later), P


class RadarNotMoved(MeanNotMoved):
    kind = "radar"


class LidarNotMoved(MeanNotMoved):
    kind = "lidar"


class NoisePerSecond:
    """Process noise as a rate, which is found by a division by the time step."""

    def process_noise(self, x: Array, dt: float) -> Array:
        with np.errstate(invalid="ignore"):
            return np.divide(super().process_noise(x, dt), dt) * dt


class StartAtOneInstant:
    """The velocity from two measurements that may be of the same time."""

    def differs(self, elapsed: float) -> bool:
        return True

    def two_measurements(self, first: Belief, second: Belief, dt: float) -> Belief:
        with np.errstate(divide="ignore", invalid="ignore"):
            return super().two_measurements(first, second, np.float64(dt))


class NoiseAlongCourse:
    """Process noise turned along the velocity, whose direction is not defined at rest."""

    def process_noise(self, x: Array, dt: float) -> Array:
        with np.errstate(invalid="ignore"):
            c, s = x[2:4] / np.hypot(x[2], x[3])
        turn = np.kron(np.eye(2), [[c, -s], [s, c]])
        return turn @ super().process_noise(x, dt) @ turn.T


class UnguardedRange:
    """Divides by the range of a target that may be where the sensor is."""

    def range(self, dx: float, dy: float) -> float:
        return np.hypot(dx, dy)

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        with np.errstate(divide="ignore", invalid="ignore"):
            return super().update(x, P, scan)


class UnguardedTurn:
    """Divides by the yaw rate, which is zero on a straight path."""

    def displacement(self, v: float, yaw: float, w: float, dt: float) -> tuple[float, float]:
        with np.errstate(divide="ignore", invalid="ignore"):
            radius = np.divide(v, w)
            return radius * (np.sin(yaw + w * dt) - np.sin(yaw)), radius * (np.cos(yaw) - np.cos(yaw + w * dt))


class UnguardedSpeed:
    """Divides by a first speed that may be zero."""

    def divisor(self, speed: float) -> float:
        return speed

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        with np.errstate(divide="ignore", invalid="ignore"):
            return super().from_cartesian(x, P)


def surviving(base: type[PlainTracker]) -> type[PlainTracker]:
    """The tracker with the covariance as a class attribute that each track changes in place."""

    class Surviving(base):  # type: ignore[misc, valid-type]
        covariance: Array | None = None

        def begin(self, track: Track, scan: Any) -> Track:
            track = super().begin(track, scan)
            if track.mean is None:
                return track
            if Surviving.covariance is None:
                Surviving.covariance = track.covariance.copy()
            return track._replace(covariance=Surviving.covariance)

        def update(self, x: Array, P: Array, scan: Any) -> Belief:
            x, P = super().update(x, P, scan)
            Surviving.covariance[:] = P
            return x, P

    return Surviving
