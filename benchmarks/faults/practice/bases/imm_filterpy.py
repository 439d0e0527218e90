"""FilterPy's IMMEstimator with two Kalman filters of constant velocity: a calm driver and one who brakes and turns."""

from copy import deepcopy

import numpy as np
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import IMMEstimator, KalmanFilter
from scipy.linalg import block_diag

# state: x, vx, y, vy
TO_OUTPUT = np.array([0, 2, 1, 3])
STD_ACC = (1.5, 5.0)
TRANSITIONS = np.array([[0.97, 0.03], [0.12, 0.88]])


def cartesian(scan, velocity):
    """Position, and of a radar the speed over ground along the ray, with H and R."""
    z = scan.measurement
    psi = scan.sensor_pose[2]
    if scan.kind != "radar":
        T = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
        H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
        return scan.sensor_pose[:2] + T @ z, H, T @ scan.noise_covariance @ T.T
    c, s = np.cos(psi + z[1]), np.sin(psi + z[1])
    rel = velocity - scan.sensor_velocity
    J = np.array([[c, -z[0] * s, 0.0], [s, z[0] * c, 0.0], [0.0, s * rel[0] - c * rel[1], 1.0]])
    along = z[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
    H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, c, 0.0, s]])
    position = scan.sensor_pose[:2] + z[0] * np.array([c, s])
    return np.append(position, along), H, J @ scan.noise_covariance @ J.T


def make_filter(scan):
    kf = KalmanFilter(dim_x=4, dim_z=2)
    z, _, R = cartesian(scan, np.zeros(2))
    kf.x = np.array([z[0], 0.0, z[1], 0.0])
    kf.P = np.diag([0.0, 400.0, 0.0, 400.0])
    kf.P[np.ix_([0, 2], [0, 2])] = R[:2, :2]
    return kf


def set_interval(kf, std, dt):
    kf.F = np.kron(np.eye(2), np.array([[1.0, dt], [0.0, 1.0]]))
    q = Q_discrete_white_noise(dim=2, dt=dt, var=std**2)
    kf.Q = block_diag(q, q)


class Tracker:
    def step(self, state, scan):
        if state is None:
            imm = IMMEstimator([make_filter(scan), make_filter(scan)], (0.5, 0.5), TRANSITIONS)
        else:
            last, imm = deepcopy(state)
            for kf, std in zip(imm.filters, STD_ACC, strict=True):
                set_interval(kf, std, scan.time - last)
            imm.predict()
            if scan.valid:
                z, H, R = cartesian(scan, imm.x[[1, 3]])
                for kf in imm.filters:
                    kf.dim_z, kf.H, kf.R = len(z), H, R
                imm.update(z)
            else:
                # the estimator itself leaves the probabilities as they are where nothing was measured
                imm.mu = imm.cbar / np.sum(imm.cbar)
                imm._compute_mixing_probabilities()
                imm._compute_state_estimate()
        x, P = self.estimate(imm)
        return (scan.time, imm), (x[TO_OUTPUT], P[np.ix_(TO_OUTPUT, TO_OUTPUT)])

    def estimate(self, imm):
        return imm.x.copy(), imm.P.copy()
