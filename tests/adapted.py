"""Filters as users of FilterPy and Stone Soup write them, for the tests of the adaptors; and measurements for them."""

from __future__ import annotations

from collections.abc import Iterator
from math import atan2, cos, hypot, sin

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from stonesoup.models.base import TimeVariantModel
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D, CartesianToElevationBearingRangeRate
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
    LinearGaussianTimeInvariantTransitionModel,
    LinearGaussianTransitionModel,
)
from stonesoup.predictor.kalman import ExtendedKalmanPredictor, SqrtKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, SqrtKalmanUpdater, UnscentedKalmanUpdater
from tests.support.peers import ACCELERATION_SIGMA, TurningRadar, ctrv_noise, ctrv_step, cv_matrices, wrap
from tests.support.scenes import LIDAR_NOISE, RADAR_NOISE, scan

from trackbench.base.types import Array, Scan
from trackbench.models.motion import ConstantTurnRateVelocity
from trackbench.models.sensors import SENSOR_MODELS

#: The state of the filters below that move at constant velocity.
STATE = ["px", "vx", "py", "vy"]
TURNING_STATE = ["px", "py", "v", "yaw", "yaw_rate"]


def measurements(steps: int = 120, uneven: bool = True) -> Iterator[Scan]:
    """Radar and lidar, of a target that weaves around a moving sensor; some missed, some at one instant."""
    random = np.random.default_rng(8)
    x, y, time = 12.0, 6.0, 0.0
    for k in range(steps):
        dt = (0.0 if k % 7 == 5 else 0.04 + 0.02 * (k % 3)) if uneven else 0.05
        course = 2.4 + 0.6 * time + 0.3 * np.sin(time)
        vx, vy = 8 * cos(course), 8 * sin(course)
        x, y, time = x + dt * vx, y + dt * vy, time + dt
        kind, noise = ("lidar", LIDAR_NOISE) if k % 2 else ("radar", RADAR_NOISE)
        pose, own = (-0.5 * time, 0.8 * time, 0.7 + 0.1 * time), (-0.5, 0.8)
        exact = SENSOR_MODELS[kind].measure(np.array([x, y, vx, vy]), np.array(pose), np.array(own))
        error = random.multivariate_normal(np.zeros(len(noise)), noise)
        yield scan(kind, time, exact + error, k % 11 != 9, pose=pose, velocity=own)


def velocity(dt: float) -> Array:
    """F of STATE."""
    return np.kron(np.eye(2), [[1, dt], [0, 1]])


def velocity_noise(dt: float) -> Array:
    """Q of STATE."""
    return ACCELERATION_SIGMA**2 * np.kron(np.eye(2), np.outer([dt**2 / 2, dt], [dt**2 / 2, dt]))


def fails(dt: float) -> Array:
    raise RuntimeError("no")


def kf() -> KalmanFilter:
    made = KalmanFilter(4, 2)
    made.H = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0]])
    return made


def kf_fixed(dt: float = 0.05, columns: bool = True) -> KalmanFilter:
    made = kf()
    made.F, made.Q, made.P = velocity(dt), velocity_noise(dt), np.diag([2.0, 50, 2, 50])
    made.x = np.array([12.0, -6, 6, 4])[:, None] if columns else np.array([12.0, -6, 6, 4])
    made.R = np.diag([0.04, 0.09])
    return made


ekf = ExtendedKalmanFilter(4, 3)


def ekf_row() -> ExtendedKalmanFilter:
    made = ExtendedKalmanFilter(4, 3)
    made.x = np.zeros(4)
    return made


def radar(x: Array, sensor_pose: Array, sensor_velocity: Array) -> Array:
    """Range, azimuth, range rate of STATE; takes rows and columns."""
    px, vx, py, vy = np.reshape(x, -1)
    dx, dy = px - sensor_pose[0], py - sensor_pose[1]
    r = hypot(dx, dy)
    rate = (dx * (vx - sensor_velocity[0]) + dy * (vy - sensor_velocity[1])) / r
    return np.array([r, atan2(dy, dx) - sensor_pose[2], rate]).reshape(-1, *np.shape(x)[1:])


def radar_slope(x: Array, sensor_pose: Array, sensor_velocity: Array) -> Array:
    px, vx, py, vy = np.reshape(x, -1)
    dx, dy, ux, uy = px - sensor_pose[0], py - sensor_pose[1], vx - sensor_velocity[0], vy - sensor_velocity[1]
    r = hypot(dx, dy)
    across = (ux * dy - uy * dx) / r**3
    return np.array(
        [[dx / r, 0, dy / r, 0], [-dy / r**2, 0, dx / r**2, 0], [dy * across, dx / r, -dx * across, dy / r]]
    )


def radar_residual(a: Array, b: Array) -> Array:
    d = a - b
    d[1] = wrap(d[1])
    return d


def lidar(x: Array, sensor_pose: Array) -> Array:
    sx, sy, yaw = sensor_pose
    px, _, py, _ = np.reshape(x, -1)
    dx, dy = px - sx, py - sy
    return np.array([cos(yaw) * dx + sin(yaw) * dy, cos(yaw) * dy - sin(yaw) * dx]).reshape(-1, *np.shape(x)[1:])


def lidar_slope(x: Array, sensor_pose: Array) -> Array:
    c, s = cos(sensor_pose[2]), sin(sensor_pose[2])
    return np.array([[c, 0, s, 0], [-s, 0, c, 0]])


def ekf_turning() -> ExtendedKalmanFilter:
    made = ExtendedKalmanFilter(5, 3)
    made.x = np.zeros(5)
    return made


def turn(x: Array, dt: float) -> Array:
    return ctrv_step(x, dt)


def turn_slope(x: Array, dt: float) -> Array:
    return ConstantTurnRateVelocity(acceleration_sigma_mps2=1.0, yaw_acceleration_sigma_radps2=1.0).jacobian(x, dt)


def turn_noise(x: Array, dt: float) -> Array:
    return ctrv_noise(x[3], dt)


def angle_difference(a: Array, b: Array) -> Array:
    d = a - b
    d[3] = wrap(d[3])
    return d


def angle_mean(points: Array, weights: Array) -> Array:
    return points[0] + weights @ np.array([angle_difference(point, points[0]) for point in points])


def ukf() -> UnscentedKalmanFilter:
    points = MerweScaledSigmaPoints(5, alpha=1.0, beta=2.0, kappa=0.0)
    return UnscentedKalmanFilter(
        5, 3, 0.05, turning_radar, ctrv_step, points, x_mean_fn=angle_mean, residual_x=angle_difference
    )


def turning_radar(x: Array, sensor_pose: Array, sensor_velocity: Array) -> Array:
    px, py, v, yaw, _ = x
    return radar(np.array([px, v * cos(yaw), py, v * sin(yaw)]), sensor_pose, sensor_velocity)


def turning_lidar(x: Array, sensor_pose: Array) -> Array:
    return lidar(np.array([x[0], 0.0, x[1], 0.0]), sensor_pose)


def radar_mean(points: Array, weights: Array) -> Array:
    return points[0] + weights @ np.array([radar_residual(point, points[0]) for point in points])


class Pushed(ConstantVelocity):
    """Constant velocity on one axis, with the acceleration constant over each interval."""

    def covar(self, time_interval, **kwargs):
        dt = time_interval.total_seconds()
        return ACCELERATION_SIGMA**2 * np.outer([dt**2 / 2, dt], [dt**2 / 2, dt])


def pair(axes: int = 2, model=None):
    moving = CombinedLinearGaussianTransitionModel([Pushed(ACCELERATION_SIGMA) for _ in range(axes)])
    return ExtendedKalmanPredictor(moving), ExtendedKalmanUpdater(model)


class Moving(LinearGaussianTransitionModel, TimeVariantModel):
    """The same of px, py, vx, vy: sigma points depend on the order of the components."""

    @property
    def ndim_state(self):
        return 4

    def matrix(self, time_interval, **kwargs):
        return np.kron([[1, time_interval.total_seconds()], [0, 1]], np.eye(2))

    def covar(self, time_interval, **kwargs):
        return cv_matrices(time_interval.total_seconds())[1]


def pair_unscented():
    options = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}
    return UnscentedKalmanPredictor(Moving(), **options), UnscentedKalmanUpdater(None, **options)


def pair_square_root():
    predictor, _ = pair()
    return SqrtKalmanPredictor(predictor.transition_model), SqrtKalmanUpdater(None)


def pair_fixed(dt: float = 0.05):
    model = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=velocity(dt), covariance_matrix=velocity_noise(dt)
    )
    first = GaussianState([12.0, -6, 6, 4], np.diag([2.0, 50, 2, 50]))
    return ExtendedKalmanPredictor(model), ExtendedKalmanUpdater(lidar_model), first


def pair_in_space():
    """Three dimensions, the third as sure as can be."""
    return *pair(3, space_model), GaussianState([0, 0, 0, 0, 0, 0], np.diag([1.0, 1, 1, 1, 1e-6, 1e-6]))


lidar_model = LinearGaussian(4, (0, 2), LIDAR_NOISE)
radar_model = CartesianToBearingRangeRate2D(4, (0, 2), np.eye(3), velocity_mapping=(1, 3))
space_model = CartesianToElevationBearingRangeRate(
    6, (0, 2, 4), np.diag([1e-4, RADAR_NOISE[1, 1], RADAR_NOISE[0, 0], RADAR_NOISE[2, 2]])
)
unknown_model = TurningRadar(noise_covar=np.eye(3), ndim_state=4)
space_lidar_model = LinearGaussian(6, (0, 2), LIDAR_NOISE)


def radar_model_at(seen: Scan) -> CartesianToBearingRangeRate2D:
    x, y, yaw = seen.sensor_pose
    return CartesianToBearingRangeRate2D(
        4, (0, 2), RADAR_NOISE[np.ix_([1, 0, 2], [1, 0, 2])], velocity_mapping=(1, 3),
        translation_offset=np.array([[x], [y]]), rotation_offset=np.array([[0], [0], [yaw]]),
        velocity=np.array(seen.sensor_velocity)[:, None],
    )  # fmt: skip
