"""An estimator after those of autopilots: one scalar observation after the other, with a struct of parameters."""

from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin

import numpy as np


def sq(value):
    return value * value


def wrap_pi(angle):
    return (angle + pi) % (2.0 * pi) - pi


@dataclass(frozen=True)
class Parameters:
    accel_noise: float = 3.0
    vel_init_noise: float = 20.0
    pos_var_min: float = 1e-9


@dataclass
class ObservationSample:
    time: float
    obs: np.ndarray
    obs_var: np.ndarray
    whiten: np.ndarray
    radar: bool
    mount: tuple
    mount_vel: tuple


class Ekf:
    k_num_states = 4

    def __init__(self, params=None):
        self._params = params or Parameters()
        self._x = np.zeros(self.k_num_states)
        self.P = np.zeros((self.k_num_states, self.k_num_states))
        self._time = None

    def clone(self):
        other = Ekf(self._params)
        other._x, other.P, other._time = self._x.copy(), self.P.copy(), self._time
        return other

    def reset(self, sample):
        x0, y0, yaw = sample.mount
        cov = sample.whiten @ sample.whiten.T
        if sample.radar:
            rng, bearing = sample.obs[0], yaw + sample.obs[1]
            J = np.array([[cos(bearing), -rng * sin(bearing)], [sin(bearing), rng * cos(bearing)]])
            local = rng * J[:, 0]
        else:
            J = np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]])
            local = J @ sample.obs
        self._x[:2] = x0 + local[0], y0 + local[1]
        self.P[:2, :2] = J @ cov[:2, :2] @ J.T
        self.P[2, 2] = self.P[3, 3] = sq(self._params.vel_init_noise)
        self._time = sample.time

    def predict(self, time):
        dt = time - self._time
        self._time = time
        self._x[0] += dt * self._x[2]
        self._x[1] += dt * self._x[3]
        F = np.eye(self.k_num_states)
        F[0, 2] = F[1, 3] = dt
        self.P = F @ self.P @ F.T
        vel_var = sq(self._params.accel_noise * dt)
        for axis in (0, 1):
            self.P[axis, axis] += vel_var * sq(dt) / 4.0
            self.P[axis + 2, axis + 2] += vel_var
            self.P[axis, axis + 2] += vel_var * dt / 2.0
            self.P[axis + 2, axis] += vel_var * dt / 2.0

    def _innovation_and_gradient(self, sample):
        x0, y0, yaw = sample.mount
        dx, dy = self._x[0] - x0, self._x[1] - y0
        if not sample.radar:
            H = np.array([[cos(yaw), sin(yaw), 0.0, 0.0], [-sin(yaw), cos(yaw), 0.0, 0.0]])
            return sample.obs - H[:, :2] @ [dx, dy], H
        du, dv = self._x[2] - sample.mount_vel[0], self._x[3] - sample.mount_vel[1]
        rng = max(hypot(dx, dy), 0.1)
        rate = (dx * du + dy * dv) / rng
        H = np.zeros((3, self.k_num_states))
        H[0, :2] = dx / rng, dy / rng
        H[1, :2] = -dy / sq(rng), dx / sq(rng)
        H[2] = (du - rate * dx / rng) / rng, (dv - rate * dy / rng) / rng, dx / rng, dy / rng
        innov = sample.obs - np.array([rng, atan2(dy, dx) - yaw, rate])
        innov[1] = wrap_pi(innov[1])
        return innov, H

    def fuse(self, sample):
        to_independent = np.linalg.inv(sample.whiten)
        for index in range(len(sample.obs)):
            innov, H = self._innovation_and_gradient(sample)
            self._fuse_scalar(to_independent[index] @ innov, to_independent[index] @ H, 1.0)

    def _fuse_scalar(self, innov, H, obs_var):
        PH = self.P @ H
        innov_var = H @ PH + obs_var
        Kfusion = np.zeros(self.k_num_states)
        for row in range(self.k_num_states):
            Kfusion[row] = PH[row] / innov_var
        kept = np.eye(self.k_num_states) - np.outer(Kfusion, H)
        self.P = kept @ self.P @ kept.T + obs_var * np.outer(Kfusion, Kfusion)
        self.P = 0.5 * (self.P + self.P.T)
        for row in range(self.k_num_states):
            self.P[row, row] = max(self.P[row, row], self._params.pos_var_min)
        self._x += Kfusion * innov


def sample_from(scan):
    noise = np.array(scan.noise_covariance, dtype=float)
    return ObservationSample(
        time=float(scan.time),
        obs=np.array(scan.measurement, dtype=float),
        obs_var=np.diag(noise),
        whiten=np.linalg.cholesky(noise),
        radar=scan.kind == "radar",
        mount=tuple(scan.sensor_pose),
        mount_vel=tuple(scan.sensor_velocity),
    )


class Tracker:
    def step(self, state, scan):
        sample = sample_from(scan)
        if state is None:
            ekf = Ekf()
            ekf.reset(sample)
        else:
            ekf = state.clone()
            ekf.predict(sample.time)
            if scan.valid:
                ekf.fuse(sample)
        return ekf, (ekf._x.copy(), ekf.P.copy())
