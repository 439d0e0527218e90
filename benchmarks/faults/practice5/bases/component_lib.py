"""A framework of exchangeable parts - states with time stamps, models, predictor, updater - and a tracker of them."""

from abc import ABC, abstractmethod
from datetime import datetime, timedelta

import numpy as np

START = datetime(2024, 5, 1)


class Bearing(float):
    """An angle of which sums and differences are wrapped."""

    def __new__(cls, value):
        return super().__new__(cls, (float(value) + np.pi) % (2 * np.pi) - np.pi)

    def __add__(self, other):
        return Bearing(float(self) + float(other))

    def __sub__(self, other):
        return Bearing(float(self) - float(other))


class GaussianState:
    def __init__(self, state_vector, covar, timestamp):
        self.state_vector = state_vector
        self.covar = covar
        self.timestamp = timestamp


class Detection:
    def __init__(self, state_vector, timestamp, measurement_model):
        self.state_vector = state_vector
        self.timestamp = timestamp
        self.measurement_model = measurement_model


class Model(ABC):
    @abstractmethod
    def function(self, state, **kwargs): ...

    @abstractmethod
    def jacobian(self, state, **kwargs): ...

    @abstractmethod
    def covar(self, **kwargs): ...


class CombinedConstantVelocity(Model):
    """x, vx, y, vy with a diffusion coefficient for each axis."""

    def __init__(self, diff_coeffs):
        self.diff_coeffs = diff_coeffs

    def function(self, state, noise=None, **kwargs):
        if noise is None:
            noise = np.zeros(4)
        return self.jacobian(state, **kwargs) @ state.state_vector + noise

    def jacobian(self, state, time_interval):
        dt = time_interval.total_seconds()
        return np.kron(np.eye(2), [[1.0, dt], [0.0, 1.0]])

    def covar(self, time_interval):
        dt = time_interval.total_seconds()
        return np.kron(np.diag(self.diff_coeffs), [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])

    def rvs(self, **kwargs):
        root = np.linalg.cholesky(self.covar(**kwargs) + 1e-12 * np.eye(4))
        return root @ np.random.default_rng().standard_normal(4)


class SensorModel(Model):
    position, velocity = np.array([0, 2]), np.array([1, 3])

    def __init__(self, noise_covar, translation_offset, rotation_offset, sensor_velocity):
        self.noise_covar = noise_covar
        self.translation_offset = translation_offset
        self.rotation_offset = rotation_offset
        self.sensor_velocity = sensor_velocity

    def covar(self):
        return self.noise_covar

    def relative(self, state):
        c, s = np.cos(self.rotation_offset), np.sin(self.rotation_offset)
        R = np.array([[c, s], [-s, c]])
        x = state.state_vector
        return R @ (x[self.position] - self.translation_offset), R @ (x[self.velocity] - self.sensor_velocity), R


class CartesianPosition(SensorModel):
    def function(self, state):
        return self.relative(state)[0]

    def jacobian(self, state):
        H = np.zeros((2, 4))
        H[:, self.position] = self.relative(state)[2]
        return H

    def inverse_function(self, z):
        c, s = np.cos(self.rotation_offset), np.sin(self.rotation_offset)
        R = np.array([[c, -s], [s, c]])
        return self.translation_offset + R @ z, R @ self.noise_covar @ R.T


class RangeBearingRate(SensorModel):
    def function(self, state):
        p, v, _ = self.relative(state)
        r = np.linalg.norm(p)
        return np.array([r, Bearing(np.arctan2(p[1], p[0])), p @ v / r], dtype=object)

    def jacobian(self, state):
        p, v, R = self.relative(state)
        r = np.linalg.norm(p)
        n, t = p / r, np.array([-p[1], p[0]]) / r
        H = np.zeros((3, 4))
        H[0, self.position] = n @ R
        H[1, self.position] = t @ R / r
        H[2, self.position] = (t @ v) * (t @ R) / r
        H[2, self.velocity] = n @ R
        return H

    def inverse_function(self, z):
        r, a = float(z[0]), float(z[1]) + self.rotation_offset
        n, t = np.array([np.cos(a), np.sin(a)]), np.array([-np.sin(a), np.cos(a)])
        J = np.column_stack([n, r * t])
        return self.translation_offset + r * n, J @ self.noise_covar[:2, :2] @ J.T


class KalmanPredictor:
    def __init__(self, transition_model):
        self.transition_model = transition_model

    def predict(self, prior, timestamp):
        interval = timestamp - prior.timestamp
        x_pred = self.transition_model.function(prior, time_interval=interval)
        F = self.transition_model.jacobian(prior, time_interval=interval)
        p_pred = F @ prior.covar @ F.T + self.transition_model.covar(time_interval=interval)
        return GaussianState(x_pred, p_pred, timestamp)


class KalmanUpdater:
    """Its own model is for detections that come without one."""

    def __init__(self, measurement_model=None):
        self.measurement_model = measurement_model

    def _check_measurement_model(self, measurement_model):
        return self.measurement_model if measurement_model is None else measurement_model

    def predict_measurement(self, predicted, measurement_model=None):
        model = self._check_measurement_model(measurement_model)
        H = model.jacobian(predicted)
        cross_cov = predicted.covar @ H.T
        return model.function(predicted), H, H @ cross_cov + model.covar(), cross_cov

    def update(self, predicted, detection):
        model = detection.measurement_model
        if self.measurement_model is None:
            self.measurement_model = model
        z_pred, H, innov_cov, cross_cov = self.predict_measurement(predicted, model)
        innovation = np.array(detection.state_vector - z_pred, dtype=float)
        K = cross_cov @ np.linalg.inv(innov_cov)
        mean = predicted.state_vector + K @ innovation
        I_KH = np.eye(len(mean)) - K @ H
        covar = I_KH @ predicted.covar @ I_KH.T + K @ self._check_measurement_model(model).covar() @ K.T
        return GaussianState(mean, (covar + covar.T) / 2, predicted.timestamp)


def detection_of(scan):
    args = (
        np.array(scan.noise_covariance),
        np.array(scan.sensor_pose[:2]),
        float(scan.sensor_pose[2]),
        np.array(scan.sensor_velocity),
    )
    when = START + timedelta(seconds=float(scan.time))
    if scan.kind == "lidar":
        return Detection(np.array(scan.measurement), when, CartesianPosition(*args))
    r, a, rate = scan.measurement
    z = np.array([r, a, rate], dtype=object)
    if scan.valid:
        z[1] = Bearing(a)
    return Detection(z, when, RangeBearingRate(*args))


class Tracker:
    """Each track has a predictor and updaters of its own, one for a kind of sensor."""

    def step(self, state, scan):
        detection = detection_of(scan)
        if state is None:
            place, R = detection.measurement_model.inverse_function(detection.state_vector)
            covar = np.diag([0.0, 400.0, 0.0, 400.0])
            covar[np.ix_([0, 2], [0, 2])] = R
            track = GaussianState(np.array([place[0], 0.0, place[1], 0.0]), covar, detection.timestamp)
            parts = KalmanPredictor(CombinedConstantVelocity([0.6, 0.6])), {}
        else:
            track, parts = state
            predictor, updaters = parts
            track = predictor.predict(track, detection.timestamp)
            if scan.valid:
                updater = KalmanUpdater(updaters.get(scan.kind))
                track = updater.update(track, detection)
                parts = predictor, updaters | {scan.kind: updater.measurement_model}
        order = np.array([0, 2, 1, 3])
        covar = track.covar[np.ix_(order, order)]
        return (track, parts), (track.state_vector[order], (covar + covar.T) / 2)
