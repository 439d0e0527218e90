"""Wrong models, and filters that correct wrongly, to be put into trackbench's own trackers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.base.units import wrap_angle
from trackbench.filters import Belief, Measured, PredictedMeasurement, SingleModelFilter, Update
from trackbench.models.motion import InitialSigmas
from trackbench.models.motion.ctrv import ConstantTurnRateVelocity
from trackbench.models.motion.cv import ConstantVelocity
from trackbench.models.sensors import SENSOR_MODELS, Lidar, Radar
from trackbench.models.sensors.radar import along_sight

from .jacobian_faults import RadarRow


class RadarNotWrapped(Radar):
    angular: ClassVar[tuple[int, ...]] = ()


class RadarByArctan(Radar):
    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        r, azimuth, rate = super().measure(target, pose, velocity)
        return linalg.vector([r, np.arctan(np.tan(azimuth)), rate])


class RadarInDegrees(Radar):
    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        r, azimuth, rate = super().measure(target, pose, velocity)
        return linalg.vector([r, np.degrees(azimuth), rate])


class RadarRateNegated(Radar):
    """In the prediction; the Jacobian is right."""

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        r, azimuth, rate = super().measure(target, pose, velocity)
        return linalg.vector([r, azimuth, -rate])


class RadarOfSpeed(Radar):
    """Speed where the range rate belongs, consistently."""

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        r, azimuth, _ = super().measure(target, pose, velocity)
        return linalg.vector([r, azimuth, np.hypot(target[2], target[3])])

    @classmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        h = super().jacobian(target, pose, velocity)
        inverse = 1.0 / np.maximum(np.hypot(target[2], target[3]), 1e-6)
        return linalg.matrix([[*h[0]], [*h[1]], [0, 0, target[2] * inverse, target[3] * inverse]])

    @classmethod
    def radial_velocity(cls, scan: Scan) -> Array:
        return along_sight(scan)


class RadarPolarStart(Radar):
    """Range and azimuth as px and py."""

    @classmethod
    def position(cls, scan: Scan) -> Gaussian:
        return Gaussian(scan.measurement[:2], np.eye(2))


class RadarWithoutGuard(Radar):
    """Divides by the range of a target that may be where the sensor is."""

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        _, azimuth, rate = super().measure(target, pose, velocity)
        distance = np.hypot(target[0] - pose[0], target[1] - pose[1])
        with np.errstate(invalid="ignore"):
            return linalg.vector([distance, azimuth, rate * np.divide(distance, distance)])


def radar_with_jacobian(fault: type[RadarRow]) -> type[Radar]:
    """A radar with one fault of the Jacobians."""

    class RadarWithJacobian(Radar):
        @classmethod
        def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
            h = super().jacobian(target, pose, velocity)
            offset = target[:2] - linalg.expand(pose[:2], target)
            fault().change(h, offset, target[2:] - linalg.expand(velocity, target))
            return h

    return RadarWithJacobian


class LidarNotTurned(Lidar):
    """The Jacobian without the sensor's yaw, which the prediction has."""

    @classmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        return np.eye(2, 4)


class TimeStepMissing(ConstantVelocity):
    """The Jacobian without dt."""

    def jacobian(self, x: Array, dt: float) -> Array:
        return np.eye(4)


class NoisePerSecond:
    """Process noise as a rate, which is found by a division by the time step."""

    def noise_gain(self, x: Array, dt: float) -> Array:
        with np.errstate(invalid="ignore"):
            return np.divide(super().noise_gain(x, dt), dt) * dt


class VelocityNoisePerSecond(NoisePerSecond, ConstantVelocity):
    pass


class TurningNoisePerSecond(NoisePerSecond, ConstantTurnRateVelocity):
    pass


class NoiseOfFixedStep:
    """The process noise of a tenth of a second at every step."""

    def noise_gain(self, x: Array, dt: float) -> Array:
        return super().noise_gain(x, 0.1)


class VelocityNoiseOfFixedStep(NoiseOfFixedStep, ConstantVelocity):
    pass


class TurningNoiseOfFixedStep(NoiseOfFixedStep, ConstantTurnRateVelocity):
    pass


class CourseNotWrapped(ConstantTurnRateVelocity):
    """Each course is in (-pi, pi], and differences of courses are taken as they are."""

    angular: ClassVar[tuple[int, ...]] = ()

    def transition(self, x: Array, dt: float) -> Array:
        later = super().transition(x, dt)
        return linalg.vector([*later[:3], wrap_angle(later[3]), later[4]])


class TurnNotGuarded(ConstantTurnRateVelocity):
    """Divides by the yaw rate, which is zero on a straight path."""

    def transition(self, x: Array, dt: float) -> Array:
        px, py, v, yaw, w = x
        later = yaw + w * dt
        with np.errstate(divide="ignore", invalid="ignore"):
            radius = np.divide(v, w)
            dx, dy = radius * (np.sin(later) - np.sin(yaw)), radius * (np.cos(yaw) - np.cos(later))
        return linalg.vector([px + dx, py + dy, v, later, w])


class CourseByArctan(ConstantTurnRateVelocity):
    """The first course by arctan(vy / vx): backwards where vx is negative."""

    def from_cartesian(self, belief: Gaussian, spread: InitialSigmas) -> Gaussian:
        x, p = super().from_cartesian(belief, spread)
        return Gaussian(linalg.vector([x[0], x[1], x[2], np.arctan(np.tan(x[3])), x[4]]), p)


@dataclass(frozen=True)
class Corrected(SingleModelFilter):
    """A filter whose corrections are changed: ``change(before, after, scan)`` gives the belief in place of after."""

    filter: SingleModelFilter
    change: Callable[[Belief, Belief, Scan], Belief]

    def predict(self, belief: Belief, dt: float) -> Belief:
        return self.filter.predict(belief, dt)

    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        return self.filter.cross_covariance(belief, dt)

    def measured(self, scan: Scan) -> Measured:
        return self.filter.measured(scan)

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        return self.filter.predict_measurement(belief, scan)

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update:
        update = self.filter.update(belief, scan, predicted)
        return update._replace(belief=self.change(belief, update.belief, scan))


def upper_triangle_off(_before: Belief, after: Belief, _scan: Scan) -> Belief:
    """By a thousandth."""
    p = after.covariance
    return Belief(after.mean, p * linalg.expand(1.0 + np.triu(np.full(p.shape[:2], 1e-3), 1), p))


def subtracts_too_much(before: Belief, after: Belief, _scan: Scan) -> Belief:
    """Half as much again as the correction takes from the covariance."""
    return Belief(after.mean, before.covariance - 1.5 * (before.covariance - after.covariance))


def mean_kept(kind: str) -> Callable[[Belief, Belief, Scan], Belief]:
    """A sensor's correction narrows the covariance, and the corrected mean is thrown away."""
    return lambda before, after, scan: Belief(before.mean, after.covariance) if scan.kind == kind else after


def covariance_kept(before: Belief, after: Belief, _scan: Scan) -> Belief:
    return Belief(after.mean, before.covariance)


def velocity_shrunk(_before: Belief, after: Belief, scan: Scan) -> Belief:
    """By a fiftieth; of a state with a speed, the speed."""
    mean = after.mean.copy()
    mean[2 : 4 if len(mean) == 4 else 3] *= np.where(scan.valid, 0.98, 1.0)
    return after._replace(mean=mean, factor=None, points=None)


def gated(before: Belief, after: Belief, scan: Scan) -> Belief:
    """Measurements farther than 5 m from the prediction are rejected, however uncertain it is."""
    seen = SENSOR_MODELS[scan.kind].position(scan).mean
    far = np.hypot(*(seen - before.mean[:2])) > 5.0
    mean = np.where(far, before.mean, after.mean)
    return Belief(mean, np.where(far, before.covariance, after.covariance))
