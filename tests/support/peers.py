"""FilterPy and Stone Soup on the measurements of one target, as their documentation uses them.

The radar is at rest at the origin and looks along x; instants are ``dt`` apart, the first belief is of the first one.
Each function returns the estimates ``(steps, n)``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from math import atan2, cos, hypot, pi, sin

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from stonesoup.base import Property
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D, _AngleNonLinearGaussianMeasurement
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.models.transition.nonlinear import GaussianTransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.angle import Bearing
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

from trackbench.base.types import Array, Scan

Peer = Callable[[Array, Array, Sequence[Scan], float], Array]

#: Driving noise of the models below.
ACCELERATION_SIGMA = 2.0
YAW_ACCELERATION_SIGMA = 0.4


def wrap(angle: float) -> float:
    return (angle + pi) % (2 * pi) - pi


def cv_matrices(dt: float) -> tuple[Array, Array]:
    gain = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
    return np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1.0]]), ACCELERATION_SIGMA**2 * gain @ gain.T


def ctrv_step(x: Array, dt: float) -> Array:
    px, py, v, yaw, w = x
    if abs(w) > 1e-6:
        r = v / w
        px, py = px + r * (sin(yaw + w * dt) - sin(yaw)), py + r * (cos(yaw) - cos(yaw + w * dt))
    else:
        px, py = px + v * cos(yaw) * dt, py + v * sin(yaw) * dt
    return np.array([px, py, v, yaw + w * dt, w])


def ctrv_noise(yaw: float, dt: float) -> Array:
    c, s = dt**2 / 2 * cos(yaw), dt**2 / 2 * sin(yaw)
    gain = np.array([[c, 0], [s, 0], [dt, 0], [0, dt**2 / 2], [0, dt]])
    return gain @ np.diag([ACCELERATION_SIGMA**2, YAW_ACCELERATION_SIGMA**2]) @ gain.T


def filterpy_ekf_cv(mean: Array, covariance: Array, scans: Sequence[Scan], dt: float) -> Array:
    def radar(x: Array) -> Array:
        r = hypot(x[0], x[1])
        return np.array([r, atan2(x[1], x[0]), (x[0] * x[2] + x[1] * x[3]) / r])

    def radar_slope(x: Array) -> Array:
        px, py, vx, vy = x
        square = px * px + py * py
        r = square**0.5
        across = (vx * py - vy * px) / (r * square)
        return np.array(
            [
                [px / r, py / r, 0, 0],
                [-py / square, px / square, 0, 0],
                [py * across, -px * across, px / r, py / r],
            ]
        )

    def radar_residual(a: Array, b: Array) -> Array:
        d = a - b
        d[1] = wrap(d[1])
        return d

    select = np.eye(2, 4)
    kalman = ExtendedKalmanFilter(4, 3)
    kalman.x, kalman.P = mean.copy(), covariance.copy()
    kalman.F, kalman.Q = cv_matrices(dt)
    found = np.empty((len(scans), 4))
    for k, scan in enumerate(scans):
        if k > 0:
            kalman.predict()
        if scan.kind == "radar":
            kalman.update(scan.measurement, radar_slope, radar, R=scan.noise_covariance, residual=radar_residual)
        else:
            kalman.update(scan.measurement, lambda _: select, lambda x: x[:2], R=scan.noise_covariance)
        found[k] = kalman.x
    return found


def filterpy_ukf_ctrv(mean: Array, covariance: Array, scans: Sequence[Scan], dt: float) -> Array:
    def radar(x: Array) -> Array:
        px, py, v, yaw, _ = x
        r = hypot(px, py)
        return np.array([r, atan2(py, px), (px * cos(yaw) + py * sin(yaw)) * v / r])

    def wrapped(index: int) -> Callable[[Array, Array], Array]:
        def residual(a: Array, b: Array) -> Array:
            d = a - b
            d[index] = wrap(d[index])
            return d

        return residual

    def mean_of(index: int) -> Callable[[Array, Array], Array]:
        def mean(points: Array, weights: Array) -> Array:
            offsets = points - points[0]
            offsets[:, index] = (offsets[:, index] + pi) % (2 * pi) - pi
            return points[0] + weights @ offsets

        return mean

    points = MerweScaledSigmaPoints(5, alpha=1.0, beta=2.0, kappa=0.0)
    kalman = UnscentedKalmanFilter(
        5, 3, dt, radar, ctrv_step, points, x_mean_fn=mean_of(3), z_mean_fn=mean_of(1), residual_x=wrapped(3)
    )
    kalman.x, kalman.P = mean.copy(), covariance.copy()
    found = np.empty((len(scans), 5))
    for k, scan in enumerate(scans):
        kalman.Q = ctrv_noise(kalman.x[3], dt if k > 0 else 0.0)
        kalman.predict(dt if k > 0 else 0.0)
        if scan.kind == "radar":
            kalman.z_mean, kalman.residual_z = mean_of(1), wrapped(1)
            kalman.update(scan.measurement, R=scan.noise_covariance)
        else:
            kalman.z_mean, kalman.residual_z = None, np.subtract
            kalman.update(scan.measurement, R=scan.noise_covariance, hx=lambda x: x[:2])
        found[k] = kalman.x
    return found


def stonesoup_ekf_cv(mean: Array, covariance: Array, scans: Sequence[Scan], dt: float) -> Array:
    f, q = cv_matrices(dt)
    predictor = ExtendedKalmanPredictor(
        LinearGaussianTimeInvariantTransitionModel(transition_matrix=f, covariance_matrix=q)
    )
    updater = ExtendedKalmanUpdater(measurement_model=None, force_symmetric_covariance=True)
    models = {
        "radar": lambda noise: CartesianToBearingRangeRate2D(4, (0, 1), noise, velocity_mapping=(2, 3)),
        "lidar": lambda noise: LinearGaussian(4, (0, 1), noise),
    }
    return _stonesoup(mean, covariance, scans, dt, predictor, updater, models)


class Turning(GaussianTransitionModel):
    """Constant turn rate and velocity; the yaw at the start of the interval comes with the call."""

    @property
    def ndim_state(self) -> int:
        return 5

    def function(self, state, noise=False, time_interval=None, **kwargs):
        dt = time_interval.total_seconds()
        px, py, v, yaw, w = np.asarray(state.state_vector, dtype=float)
        h = w * dt / 2
        along = v * dt * np.sinc(h / np.pi)
        return StateVectors([px + along * np.cos(yaw + h), py + along * np.sin(yaw + h), v, yaw + w * dt, w])

    def covar(self, time_interval=None, yaw=0.0, **kwargs):
        return ctrv_noise(yaw, time_interval.total_seconds())

    def rvs(self, *args, **kwargs):
        raise NotImplementedError

    def pdf(self, *args, **kwargs):
        raise NotImplementedError


class TurningRadar(_AngleNonLinearGaussianMeasurement):
    """Bearing, range and range rate of a state px, py, v, yaw, yaw rate."""

    ndim_state: int = Property(default=5)
    mapping: Sequence[int] = Property(default=(0, 1))

    @property
    def ndim_meas(self) -> int:
        return 3

    def _function(self, state, noise=False, **kwargs):
        px, py, v, yaw, _ = np.asarray(state.state_vector, dtype=float)
        r = np.hypot(px, py)
        return StateVectors([np.arctan2(py, px), r, (px * np.cos(yaw) + py * np.sin(yaw)) * v / r])

    @staticmethod
    def _typed_vector():
        return np.array([[Bearing(0.0)], [0.0], [0.0]])


def stonesoup_ukf_ctrv(mean: Array, covariance: Array, scans: Sequence[Scan], dt: float) -> Array:
    options = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}
    predictor = UnscentedKalmanPredictor(Turning(), **options)
    updater = UnscentedKalmanUpdater(measurement_model=None, force_symmetric_covariance=True, **options)
    models = {
        "radar": lambda noise: TurningRadar(noise_covar=noise),
        "lidar": lambda noise: LinearGaussian(5, (0, 1), noise),
    }
    return _stonesoup(mean, covariance, scans, dt, predictor, updater, models)


def _stonesoup(mean, covariance, scans, dt, predictor, updater, models) -> Array:
    begin = datetime(2000, 1, 1)
    # Stone Soup's order is bearing, range, range rate.
    order = {"radar": [1, 0, 2], "lidar": [0, 1]}
    noise = {scan.kind: scan.noise_covariance[np.ix_(order[scan.kind], order[scan.kind])] for scan in scans}
    models = {kind: models[kind](noise[kind]) for kind in noise}
    state = GaussianState(mean[:, None], covariance, timestamp=begin)
    found = np.empty((len(scans), len(mean)))
    for k, scan in enumerate(scans):
        time = begin + timedelta(seconds=k * dt)
        if k > 0:
            yaw = {"yaw": float(state.state_vector[3, 0])} if len(mean) == 5 else {}
            prediction = predictor.predict(state, timestamp=time, **yaw)
        else:
            prediction = GaussianStatePrediction(state.state_vector, state.covar, timestamp=begin)
        measurement = scan.measurement[order[scan.kind]].astype(object)
        if scan.kind == "radar":
            measurement[0] = Bearing(measurement[0])
        detection = Detection(measurement[:, None], timestamp=time, measurement_model=models[scan.kind])
        state = updater.update(SingleHypothesis(prediction, detection))
        found[k] = state.state_vector[:, 0]
    return found
