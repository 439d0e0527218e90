"""Nearly constant turn in Cartesian components, after a library of models: x, vx, y, vy and the turn rate."""

import numpy as np


class ConstantTurn:
    """Noise of the acceleration on each axis, and of the turn rate."""

    ndim_state = 5

    def __init__(self, linear_noise_coeff=0.6, turn_noise_coeff=0.04):
        self.linear_noise_coeff = linear_noise_coeff
        self.turn_noise_coeff = turn_noise_coeff

    @staticmethod
    def _integrals(w, T):
        """Of cosine and sine over the interval, and their derivatives by the turn rate."""
        a = w * T
        if abs(a) < 1e-3:
            return T - w**2 * T**3 / 6, w * T**2 / 2, -w * T**3 / 3, T**2 / 2
        s, c = np.sin(a), np.cos(a)
        return s / w, (1 - c) / w, (a * c - s) / w**2, (a * s - (1 - c)) / w**2

    def function(self, state, T):
        x, vx, y, vy, w = state
        S, C, _, _ = self._integrals(w, T)
        s, c = np.sin(w * T), np.cos(w * T)
        return np.array([x + S * vx - C * vy, c * vx - s * vy, y + C * vx + S * vy, s * vx + c * vy, w])

    def jacobian(self, state, T):
        _, vx, _, vy, w = state
        S, C, dS, dC = self._integrals(w, T)
        s, c = np.sin(w * T), np.cos(w * T)
        F = np.eye(self.ndim_state)
        F[0, 1], F[0, 3] = S, -C
        F[1, 1], F[1, 3] = c, -s
        F[2, 1], F[2, 3] = C, S
        F[3, 1], F[3, 3] = s, c
        F[0, 4] = dS * vx - dC * vy
        F[1, 4] = -T * (s * vx + c * vy)
        F[2, 4] = dC * vx + dS * vy
        F[3, 4] = T * (c * vx - s * vy)
        return F

    def covar(self, T):
        Q = np.zeros((self.ndim_state, self.ndim_state))
        base = np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
        Q[0:2, 0:2] = Q[2:4, 2:4] = base * self.linear_noise_coeff
        Q[4, 4] = self.turn_noise_coeff * T
        return Q


class Sensor:
    pos_map, vel_map = [0, 2], [1, 3]

    def __init__(self, scan):
        self.position = np.array(scan.sensor_pose[:2])
        self.rotation = float(scan.sensor_pose[2])
        self.velocity = np.array(scan.sensor_velocity)
        self.noise = np.array(scan.noise_covariance)

    def unit_vectors(self, angle):
        return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])


class Lidar(Sensor):
    def matrix(self):
        return np.vstack(self.unit_vectors(self.rotation))

    def predict(self, state):
        H = np.zeros((2, 5))
        H[:, self.pos_map] = self.matrix()
        return self.matrix() @ (state[self.pos_map] - self.position), H

    def innovation(self, z, predicted):
        return z - predicted

    def invert(self, z):
        C = self.matrix().T
        mean, P = np.zeros(5), np.diag([0.0, 400.0, 0.0, 400.0, 0.04])
        mean[self.pos_map] = self.position + C @ z
        P[np.ix_(self.pos_map, self.pos_map)] = C @ self.noise @ C.T
        return mean, P


class Radar(Sensor):
    def predict(self, state):
        d, v = state[self.pos_map] - self.position, state[self.vel_map] - self.velocity
        r = max(np.hypot(*d), 0.05)
        n = d / r
        t = np.array([-n[1], n[0]])
        H = np.zeros((3, 5))
        H[0, self.pos_map] = n
        H[1, self.pos_map] = t / r
        H[2, self.pos_map] = (t @ v) * t / r
        H[2, self.vel_map] = n
        return np.array([r, np.arctan2(d[1], d[0]) - self.rotation, n @ v]), H

    def innovation(self, z, predicted):
        gap = z - predicted
        gap[1] = np.angle(np.exp(1j * gap[1]))
        return gap

    def invert(self, z):
        """The range rate tells the velocity along the ray; across it is unknown."""
        n, t = self.unit_vectors(self.rotation + z[1])
        J = np.column_stack([n, z[0] * t])
        mean, P = np.zeros(5), np.diag([0.0, 0.0, 0.0, 0.0, 0.04])
        mean[self.pos_map] = self.position + z[0] * n
        mean[self.vel_map] = (z[2] + n @ self.velocity) * n
        P[np.ix_(self.pos_map, self.pos_map)] = J @ self.noise[:2, :2] @ J.T
        along = self.noise[2, 2] + 400.0 * self.noise[1, 1]
        P[np.ix_(self.vel_map, self.vel_map)] = along * np.outer(n, n) + 400.0 * np.outer(t, t)
        return mean, P


class Tracker:
    transition = ConstantTurn()
    order = np.array([0, 2, 1, 3])

    def step(self, state, scan):
        sensor = Radar(scan) if scan.kind == "radar" else Lidar(scan)
        z = np.array(scan.measurement, dtype=float)
        if state is None:
            mean, P = sensor.invert(z)
        else:
            time, mean, P = state
            T = scan.time - time
            if T > 0:
                F = self.transition.jacobian(mean, T)
                mean = self.transition.function(mean, T)
                P = F @ P @ F.T + self.transition.covar(T)
            if scan.valid:
                expected, H = sensor.predict(mean)
                S = H @ P @ H.T + sensor.noise
                K = np.linalg.solve(S, H @ P).T
                mean = mean + K @ sensor.innovation(z, expected)
                A = np.eye(5) - K @ H
                P = A @ P @ A.T + K @ sensor.noise @ K.T
        P = (P + P.T) / 2
        time = scan.time if state is None else max(time, scan.time)
        return (time, mean, P), (mean[self.order], P[np.ix_(self.order, self.order)])
