"""After robot_localization: a measurement names the components it updates; a Mahalanobis gate stands before the update.

State x, y, vx, vy of the object; a radar's measurement is predicted in polar form.
"""

import math
from types import SimpleNamespace

import numpy as np


class Ekf:
    def __init__(self, state, covariance, time):
        self.state_, self.estimate_error_covariance_, self.last_measurement_time_ = state, covariance, time

    def copy(self):
        return Ekf(self.state_.copy(), self.estimate_error_covariance_.copy(), self.last_measurement_time_)

    def predict(self, reference_time):
        delta = reference_time - self.last_measurement_time_
        transfer_function_ = np.eye(4) + delta * np.eye(4, k=2)
        noise = np.vstack([delta**2 / 2 * np.eye(2), delta * np.eye(2)])
        process_noise_covariance_ = 9.0 * noise @ noise.T
        self.state_ = transfer_function_ @ self.state_
        P = transfer_function_ @ self.estimate_error_covariance_ @ transfer_function_.T
        self.estimate_error_covariance_ = P + process_noise_covariance_
        self.last_measurement_time_ = reference_time

    def correct(self, measurement):
        H, R = measurement.jacobian, measurement.covariance_
        P = self.estimate_error_covariance_
        pht = P @ H.T
        hphr_inverse = np.linalg.inv(H @ pht + R)
        kalman_gain = pht @ hphr_inverse
        innovation = measurement.measurement_ - measurement.predicted
        for i in measurement.angles:
            while innovation[i] < -math.pi:
                innovation[i] += 2 * math.pi
            while innovation[i] > math.pi:
                innovation[i] -= 2 * math.pi
        if self.check_mahalanobis_threshold(innovation, hphr_inverse, measurement.mahalanobis_thresh_):
            self.state_ = self.state_ + kalman_gain @ innovation
            gain_residual = np.eye(4) - kalman_gain @ H
            self.estimate_error_covariance_ = gain_residual @ P @ gain_residual.T + kalman_gain @ R @ kalman_gain.T

    def check_mahalanobis_threshold(self, innovation, inv_covariance, n_sigmas):
        return innovation @ inv_covariance @ innovation < n_sigmas**2


class Tracker:
    def step(self, state, scan):
        if state is None:
            ekf = self.first(scan)
        else:
            ekf = state.copy()
            ekf.predict(scan.time)
            if scan.valid:
                ekf.correct(self.radar(ekf, scan) if scan.kind == "radar" else self.lidar(ekf, scan))
        return ekf, (ekf.state_.copy(), ekf.estimate_error_covariance_.copy())

    def first(self, scan):
        yaw = scan.sensor_pose[2]
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if scan.kind == "radar" else (1.0, yaw)
        c, s = math.cos(angle), math.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])
        position = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if scan.kind == "radar" else scan.measurement)
        P = np.diag([0.0, 0.0, 900.0, 900.0])
        P[:2, :2] = J @ scan.noise_covariance[:2, :2] @ J.T
        return Ekf(np.array([*position, 0.0, 0.0]), P, scan.time)

    def radar(self, ekf, scan):
        dx, dy = ekf.state_[:2] - scan.sensor_pose[:2]
        ux, uy = ekf.state_[2:] - scan.sensor_velocity
        r = math.hypot(dx, dy)
        turn = (ux * dy - uy * dx) / r**3
        jacobian = np.array(
            [
                [dx / r, dy / r, 0, 0],
                [-dy / r**2, dx / r**2, 0, 0],
                [dy * turn, -dx * turn, dx / r, dy / r],
            ]
        )
        predicted = np.array([r, math.atan2(dy, dx) - scan.sensor_pose[2], (dx * ux + dy * uy) / r])
        return self.measurement(scan, predicted, jacobian, angles=[1])

    def lidar(self, ekf, scan):
        yaw = scan.sensor_pose[2]
        turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        predicted = turn @ (ekf.state_[:2] - scan.sensor_pose[:2])
        return self.measurement(scan, predicted, np.hstack([turn, np.zeros((2, 2))]), angles=[])

    def measurement(self, scan, predicted, jacobian, angles):
        return SimpleNamespace(
            measurement_=scan.measurement.copy(),
            covariance_=scan.noise_covariance,
            mahalanobis_thresh_=6.0,
            predicted=predicted,
            jacobian=jacobian,
            angles=angles,
        )
