"""Faults as people make them, in what a plain tracker does at each step; methods that override the correct ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .mutant import ExaminedTracker, Mutant
from .plain import Array, Belief, Track, rotation, symmetric
from .plain_ekf import ConstantVelocity
from .plain_ukf import ConstantTurnRate


class InPlace:
    """Entries of P = (I - K H) P that are changed already are used for later ones."""

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        kept, P = np.eye(len(P)) - K @ np.linalg.solve(P, K @ S).T, P.copy()
        for i in range(len(P)):
            for j in range(len(P)):
                P[i, j] = kept[i] @ P[:, j]
        return symmetric(P)


class OtherTime:
    """The prediction is over another time than that since the last scan."""

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        return super().predict(x, P, self.time(dt))


class WholeSeconds(OtherTime):
    def time(self, dt: float) -> float:
        return float(int(dt))


class TenthsOfSeconds(OtherTime):
    def time(self, dt: float) -> float:
        return round(dt, 1)


class AtMostAFifth(OtherTime):
    def time(self, dt: float) -> float:
        return min(dt, 0.2)


class LongStepsLeftOut(OtherTime):
    def time(self, dt: float) -> float:
        return dt if dt < 0.5 else 0.0


class MissedTimeNotStored:
    """A missed scan is predicted to, and the time before it counts again."""

    def advance(self, track: Track, scan: Any) -> Track:
        later = super().advance(track, scan)
        return later if scan.valid else later._replace(time=track.time)


class EgoAdded:
    """The sensor's own velocity has the wrong sign."""

    def range_rate(self, target: Array, scan: Any) -> float:
        return super().range_rate(target, scan._replace(sensor_velocity=self.own(scan)))

    def own(self, scan: Any) -> Array:
        return -scan.sensor_velocity


class EgoTurned(EgoAdded):
    """It is turned into the sensor's frame, and the target's velocity is not."""

    def own(self, scan: Any) -> Array:
        return rotation(scan.sensor_pose[2]).T @ scan.sensor_velocity


class EgoAlongBoresight(EgoAdded):
    """Its component along the boresight is taken for that along the line of sight."""

    def range_rate(self, target: Array, scan: Any) -> float:
        still = scan._replace(sensor_velocity=np.zeros(2))
        along = rotation(scan.sensor_pose[2])[:, 0] @ scan.sensor_velocity
        return super(EgoAdded, self).range_rate(target, still) - along


class EgoSpeed(EgoAdded):
    """The observer's speed is subtracted from the range rate."""

    def range_rate(self, target: Array, scan: Any) -> float:
        still = scan._replace(sensor_velocity=np.zeros(2))
        return super(EgoAdded, self).range_rate(target, still) - np.hypot(*scan.sensor_velocity)


class PositionAdded:
    """The sensor's position has the wrong sign."""

    def predicted_measurement(self, target: Array, scan: Any) -> Array:
        return super().predicted_measurement(target, scan._replace(sensor_pose=scan.sensor_pose * [-1, -1, 1]))


class TurnedTheOtherWay:
    """The sensor's yaw has the wrong sign."""

    def predicted_measurement(self, target: Array, scan: Any) -> Array:
        return super().predicted_measurement(target, scan._replace(sensor_pose=scan.sensor_pose * [1, 1, -1]))


class TransitionAlone:
    """A comma for a product: the covariance before is dropped."""

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        moved, _ = super().predict(x, P, dt)
        F = ConstantVelocity.transition_jacobian(self, dt)
        return moved, F @ F.T + self.process_noise(x, dt)


class NoiseForCovariance:
    """The predicted covariance is the process noise."""

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        moved, _ = super().predict(x, P, dt)
        return moved, self.process_noise(x, dt) + 1e-9 * np.eye(len(x))


class AboutTheOldMean:
    """The spread of the moved points is that about the mean before the prediction."""

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        before = x.copy()
        mean, P = super().predict(x, P, dt)
        apart = self.state_spread(mean[None], before)[0]
        return mean, P + np.outer(apart, apart)


class Returns:
    """Something else is returned for the covariance."""

    def output(self, x: Array, P: Array) -> Belief:
        mean, covariance = super().output(x, P)
        return mean, self.returned(covariance)

    def returned(self, P: Array) -> Array:
        raise NotImplementedError


class ReturnsNoise(Returns):
    """The process noise of the last step."""

    last = 0.1

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        self.last = dt
        return super().predict(x, P, dt)

    def returned(self, P: Array) -> Array:
        return ConstantVelocity.process_noise(self, np.zeros(4), self.last) + 1e-8 * np.eye(4)


class ReturnsPrecision(Returns):
    def returned(self, P: Array) -> Array:
        return symmetric(np.linalg.inv(P))


class ReturnsRoot(Returns):
    """The symmetric root."""

    def returned(self, P: Array) -> Array:
        values, vectors = np.linalg.eigh(P)
        return symmetric(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)


class NoiseOfPosition:
    """The process noise grows with the position in x."""

    def process_noise(self, x: Array, dt: float) -> Array:
        return (x[0] / 10) ** 2 * super().process_noise(x, dt)


class SecondOfLidarUnused:
    """The gain of y of a lidar is never computed and stays zero; in the fixed frame."""

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        if scan.kind != "lidar":
            return super().update(x, P, scan)
        z, R = self.position(scan)
        S = P[:2, :2] + R
        K = np.linalg.solve(S, P[:2]).T
        K[:, 1] = 0.0
        return x + K @ (z - x[:2]), symmetric(P - K @ P[:2])


class TurningEkf(ConstantTurnRate):
    """An extended Kalman filter of the turning model: the Jacobians are differences."""

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        F = self.motion_jacobian(x, dt)
        return self.transition(x, dt), symmetric(F @ P @ F.T) + self.process_noise(x, dt)

    def motion_jacobian(self, x: Array, dt: float) -> Array:
        return differences(lambda one: self.transition(one, dt), x)

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        def model(one: Array) -> Array:
            return self.predicted_measurement(self.cartesian(one), scan)

        y, H = self.innovation(scan, model(x)), differences(model, x)
        S = H @ P @ H.T + self.noise(scan)
        return self.corrected(x, P, np.linalg.solve(S, H @ P).T, y, S)


def differences(model: Any, x: Array) -> Array:
    return np.stack([(model(x + step) - model(x - step)) / 2e-5 for step in 1e-5 * np.eye(len(x))], axis=1)


class TurnRateIgnored:
    """The motion's Jacobian as if the position did not depend on the turn rate, nor the course."""

    def motion_jacobian(self, x: Array, dt: float) -> Array:
        F = super().motion_jacobian(x, dt)
        F[:4, 4] = 0.0
        return F


class CourseSign:
    """d px / d course with the wrong sign."""

    def motion_jacobian(self, x: Array, dt: float) -> Array:
        F = super().motion_jacobian(x, dt)
        F[0, 3] *= -1
        return F


class AfterTheMove:
    """The motion's Jacobian at the predicted state."""

    def motion_jacobian(self, x: Array, dt: float) -> Array:
        return super().motion_jacobian(self.transition(x, dt), dt)


TURNING_EKF = ExaminedTracker("turning_ekf", TurningEkf, turning=True)
TIMES = [
    ("whole_seconds", WholeSeconds),
    ("tenths", TenthsOfSeconds),
    ("at_most_0.2", AtMostAFifth),
    ("long_left_out", LongStepsLeftOut),
    ("missed_not_stored", MissedTimeNotStored),
]
EGO = [
    ("added", EgoAdded),
    ("turned", EgoTurned),
    ("boresight", EgoAlongBoresight),
    ("speed", EgoSpeed),
]
POSES = [("position_added", PositionAdded), ("turned_other_way", TurnedTheOtherWay)]
RETURNED = [("noise", ReturnsNoise), ("precision", ReturnsPrecision), ("root", ReturnsRoot)]


def mutants(subject: ExaminedTracker) -> Iterator[Mutant]:
    yield subject.mixed("covariance_update_wrong", "in_place", InPlace)
    for variant, time in TIMES:
        yield subject.mixed("wrong_dt", variant, time)
    for variant, returned in RETURNED:
        yield subject.mixed("wrong_covariance_returned", variant, returned)
    if not subject.turning:
        for variant, prediction in (("transition_alone", TransitionAlone), ("noise", NoiseForCovariance)):
            yield subject.mixed("predicted_covariance_wrong", variant, prediction)
        yield subject.mixed("measurement_ignored", "lidar_y", SecondOfLidarUnused, "lidar")
    yield subject.mixed("q_depends_on_state", "px", NoiseOfPosition)
    if subject.uses_rate:
        for variant, ego in EGO:
            yield subject.mixed("ego_motion_wrong", variant, ego, "radar")
        for variant, pose in POSES:
            yield subject.mixed("ego_motion_wrong", variant, pose)


def sigma_points(subject: ExaminedTracker) -> Iterator[Mutant]:
    yield subject.mixed("predicted_covariance_wrong", "about_old_mean", AboutTheOldMean)


def motion(subject: ExaminedTracker) -> Iterator[Mutant]:
    for variant, jacobian in (
        ("turn_rate_ignored", TurnRateIgnored),
        ("course_sign", CourseSign),
        ("after_the_move", AfterTheMove),
    ):
        yield subject.mixed("jacobian_wrong", variant, jacobian)
