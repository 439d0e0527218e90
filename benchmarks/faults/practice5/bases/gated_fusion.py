"""Sensor fusion with strategies: a motion model, an observation model for each sensor, and a validation gate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Belief:
    stamp: float
    mean: np.ndarray
    cov: np.ndarray
    rejected: int = 0


class MotionModel(Protocol):
    def propagate(self, belief: Belief, stamp: float) -> Belief: ...


class ObservationModel(Protocol):
    angles: tuple[int, ...]

    def expect(self, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...


@dataclass(frozen=True)
class NearlyConstantVelocity:
    """Continuous white noise of the acceleration, with this density in m^2/s^3."""

    density: float = 0.6

    def propagate(self, belief: Belief, stamp: float) -> Belief:
        dt = stamp - belief.stamp
        one = np.array([[1.0, dt], [0.0, 1.0]])
        noise = self.density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        F, Q = np.kron(one, np.eye(2)), np.kron(noise, np.eye(2))
        return replace(belief, stamp=stamp, mean=F @ belief.mean, cov=F @ belief.cov @ F.T + Q)


@dataclass(frozen=True)
class SensorFrame:
    origin: np.ndarray
    rotation: np.ndarray
    """Of which the columns are the sensor's axes in the world."""
    velocity: np.ndarray

    @classmethod
    def of(cls, scan) -> SensorFrame:
        yaw = scan.sensor_pose[2]
        rotation = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return cls(np.array(scan.sensor_pose[:2]), rotation, np.array(scan.sensor_velocity))

    def into(self, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Place and velocity relative to the sensor, in its axes."""
        inverse = self.rotation.T
        place = inverse @ (mean[:2] - self.origin)
        own = inverse @ self.velocity
        return place, inverse @ mean[2:] - own


class Cartesian:
    angles = ()

    def __init__(self, frame: SensorFrame):
        self.frame = frame

    def expect(self, mean):
        place, _ = self.frame.into(mean)
        return place, np.hstack([self.frame.rotation.T, np.zeros((2, 2))])


class Polar:
    angles = (1,)

    def __init__(self, frame: SensorFrame):
        self.frame = frame

    def expect(self, mean):
        (x, y), (u, v) = self.frame.into(mean)
        rho = max(np.hypot(x, y), 0.01)
        rate = (x * u + y * v) / rho
        local = np.zeros((3, 4))
        local[0, :2] = x / rho, y / rho
        local[1, :2] = -y / rho**2, x / rho**2
        local[2] = u / rho - x * rate / rho**2, v / rho - y * rate / rho**2, x / rho, y / rho
        turned = np.kron(np.eye(2), self.frame.rotation.T)
        return np.array([rho, np.arctan2(y, x), rate]), local @ turned


@dataclass(frozen=True)
class ChiSquareGate:
    """After some rejections in a row the next measurement is let in."""

    limits: tuple[float, ...] = (0.0, 10.8, 18.4, 21.1)
    patience: int = 4

    def admits(self, innovation: np.ndarray, S: np.ndarray, rejected: int) -> bool:
        weight = np.linalg.inv(S)
        return innovation @ weight @ innovation <= self.limits[len(innovation)] or rejected >= self.patience


class FusionFilter:
    def __init__(self, motion: MotionModel, gate: ChiSquareGate):
        self.motion, self.gate = motion, gate

    def correct(self, belief: Belief, model: ObservationModel, z: np.ndarray, R: np.ndarray) -> Belief:
        expected, H = model.expect(belief.mean)
        innovation = z - expected
        for i in model.angles:
            innovation[i] = np.angle(np.exp(1j * innovation[i]))
        S = H @ belief.cov @ H.T + R
        if not self.gate.admits(innovation, S, belief.rejected):
            return replace(belief, rejected=belief.rejected + 1)
        gain = np.linalg.solve(S, H @ belief.cov).T
        rest = np.eye(4) - gain @ H
        cov = rest @ belief.cov @ rest.T + gain @ R @ gain.T
        return replace(belief, mean=belief.mean + gain @ innovation, cov=(cov + cov.T) / 2, rejected=0)


class Tracker:
    def __init__(self):
        self.models = {"lidar": Cartesian, "radar": Polar}
        self.filter = FusionFilter(NearlyConstantVelocity(), ChiSquareGate())

    def born(self, scan) -> Belief:
        frame, z, R = SensorFrame.of(scan), np.array(scan.measurement), np.array(scan.noise_covariance)
        if scan.kind == "radar":
            ray = np.array([np.cos(z[1]), np.sin(z[1])])
            J = np.column_stack([ray, z[0] * np.array([-ray[1], ray[0]])])
            z, R = z[0] * ray, J @ R[:2, :2] @ J.T
        cov = np.zeros((4, 4))
        cov[:2, :2] = frame.rotation @ R @ frame.rotation.T
        cov[2:, 2:] = 20.0**2 * np.eye(2)
        return Belief(scan.time, np.concatenate([frame.origin + frame.rotation @ z, np.zeros(2)]), cov)

    def step(self, state, scan):
        if state is None:
            belief = self.born(scan)
        else:
            belief = self.filter.motion.propagate(state, scan.time)
            if scan.valid:
                model = self.models[scan.kind](SensorFrame.of(scan))
                belief = self.filter.correct(belief, model, np.array(scan.measurement), np.array(scan.noise_covariance))
        return belief, (belief.mean, (belief.cov + belief.cov.T) / 2)
