"""States with covariances, process models and a bank of extended Kalman filters: straight on, and turning at a rate."""

from dataclasses import dataclass, replace

import numpy as np

RATE_SPREAD = 0.06  # rad/s, of the turn rate that the straight model leaves


@dataclass
class StateWithCovariance:
    value: np.ndarray  # px, py, vx, vy, turn rate
    covariance: np.ndarray
    stamp: float


@dataclass
class ImmState:
    model_states: list
    model_probabilities: np.ndarray


class ProcessModel:
    sigma_a: float  # m/s^2, per root of a second

    def translation_noise(self, dt):
        Q = np.zeros((5, 5))
        q = self.sigma_a**2
        Q[:4, :4] = np.kron(q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))
        return Q


class Straight(ProcessModel):
    sigma_a = 0.7

    def evaluate(self, x, dt):
        return self.jacobian(x, dt) @ x

    def jacobian(self, x, dt):
        F = np.diag([1.0, 1.0, 1.0, 1.0, 0.0])
        F[0, 2] = F[1, 3] = dt
        return F

    def covariance(self, x, dt):
        Q = self.translation_noise(dt)
        Q[4, 4] = RATE_SPREAD**2
        return Q


class CoordinatedTurn(ProcessModel):
    sigma_a = 1.6
    sigma_w = 0.15  # rad/s, per root of a second

    @staticmethod
    def coefficients(w, dt):
        """sin(w dt) / w, (1 - cos(w dt)) / w and their derivatives by w."""
        if abs(w) < 1e-4:
            return dt, w * dt**2 / 2, 0.0, dt**2 / 2
        s, c = np.sin(w * dt), np.cos(w * dt)
        return s / w, (1 - c) / w, (dt * c * w - s) / w**2, (dt * s * w - (1 - c)) / w**2

    def evaluate(self, x, dt):
        px, py, vx, vy, w = x
        a, b, _, _ = self.coefficients(w, dt)
        s, c = np.sin(w * dt), np.cos(w * dt)
        return np.array([px + a * vx - b * vy, py + b * vx + a * vy, c * vx - s * vy, s * vx + c * vy, w])

    def jacobian(self, x, dt):
        _, _, vx, vy, w = x
        a, b, da, db = self.coefficients(w, dt)
        s, c = np.sin(w * dt), np.cos(w * dt)
        F = np.eye(5)
        F[0, 2:] = a, -b, da * vx - db * vy
        F[1, 2:] = b, a, db * vx + da * vy
        F[2, 2:] = c, -s, -dt * (s * vx + c * vy)
        F[3, 2:] = s, c, dt * (c * vx - s * vy)
        return F

    def covariance(self, x, dt):
        Q = self.translation_noise(dt)
        Q[4, 4] = self.sigma_w**2 * dt
        return Q


class LidarModel:
    def __init__(self, scan):
        self.origin, self.noise = scan.sensor_pose[:2], scan.noise_covariance
        c, s = np.cos(scan.sensor_pose[2]), np.sin(scan.sensor_pose[2])
        self.to_world = np.array([[c, -s], [s, c]])

    def evaluate(self, x):
        return self.to_world.T @ (x[:2] - self.origin)

    def jacobian(self, x):
        return np.hstack([self.to_world.T, np.zeros((2, 3))])

    def innovation(self, z, x):
        return z - self.evaluate(x)

    def place(self, z):
        return self.origin + self.to_world @ z, self.to_world @ self.noise @ self.to_world.T


class RadarModel:
    def __init__(self, scan):
        self.origin, self.yaw = scan.sensor_pose[:2], scan.sensor_pose[2]
        self.velocity, self.noise = scan.sensor_velocity, scan.noise_covariance

    def ray(self, x):
        d = x[:2] - self.origin
        r = max(np.hypot(d[0], d[1]), 0.4)
        return r, d / r, np.arctan2(d[1], d[0])

    def evaluate(self, x):
        r, u, direction = self.ray(x)
        return np.array([r, direction - self.yaw, u @ (x[2:4] - self.velocity)])

    def jacobian(self, x):
        r, u, _ = self.ray(x)
        across = np.array([-u[1], u[0]])
        H = np.zeros((3, 5))
        H[0, :2] = u
        H[1, :2] = across / r
        H[2, :2] = across * (across @ (x[2:4] - self.velocity)) / r
        H[2, 2:4] = u
        return H

    def innovation(self, z, x):
        y = z - self.evaluate(x)
        fixed = (y[1] + np.pi) % (2 * np.pi) - np.pi
        return np.array([y[0], fixed, y[2]])

    def place(self, z):
        a = self.yaw + z[1]
        e = np.array([np.cos(a), np.sin(a)])
        J = np.column_stack([e, z[0] * np.array([-e[1], e[0]])])
        return self.origin + z[0] * e, J @ self.noise[:2, :2] @ J.T


class ExtendedKalmanFilter:
    def __init__(self, process_model):
        self.process_model = process_model

    def predict(self, x, stamp):
        dt = stamp - x.stamp
        if dt <= 0.0:
            return replace(x, stamp=stamp)
        A = self.process_model.jacobian(x.value, dt)
        Q = self.process_model.covariance(x.value, dt)
        return StateWithCovariance(self.process_model.evaluate(x.value, dt), A @ x.covariance @ A.T + Q, stamp)

    def correct(self, x, z, model):
        """The corrected state, and the logarithm of the likelihood."""
        y, G = model.innovation(z, x.value), model.jacobian(x.value)
        S = G @ x.covariance @ G.T + model.noise
        K = np.linalg.solve(S, G @ x.covariance).T
        I_KG = np.eye(5) - K @ G
        P = I_KG @ x.covariance @ I_KG.T + K @ model.noise @ K.T
        log_likelihood = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(2 * np.pi * S)[1])
        return StateWithCovariance(x.value + K @ y, P, x.stamp), log_likelihood


def gaussian_mixing(weights, states):
    value = sum(w * x.value for w, x in zip(weights, states, strict=True))
    covariance = np.zeros((5, 5))
    for w, x in zip(weights, states, strict=True):
        dx = x.value - value
        covariance += w * (x.covariance + np.outer(dx, dx))
    return StateWithCovariance(value, covariance, states[0].stamp)


class InteractingModelFilter:
    """Leaves the straight model `out` times a second, and comes back `back` times a second."""

    def __init__(self, kf_list, out, back):
        self.kf_list = kf_list
        self.out, self.back = out, back

    def transition(self, dt):
        lasting = np.array([[self.back, self.out]] * 2) / (self.out + self.back)
        return lasting + np.exp(-(self.out + self.back) * dt) * (np.eye(2) - lasting)

    def interaction(self, imm, dt):
        joint = imm.model_probabilities[:, None] * self.transition(dt)  # from the row to the column
        c = joint.sum(axis=0)
        mixed = [gaussian_mixing(joint[:, j] / c[j], imm.model_states) for j in range(len(c))]
        return ImmState(mixed, c)

    def predict(self, imm, stamp):
        imm = self.interaction(imm, max(stamp - imm.model_states[0].stamp, 0.0))
        states = [kf.predict(x, stamp) for kf, x in zip(self.kf_list, imm.model_states, strict=True)]
        return ImmState(states, imm.model_probabilities)

    def correct(self, imm, z, model):
        pairs = [kf.correct(x, z, model) for kf, x in zip(self.kf_list, imm.model_states, strict=True)]
        imm = ImmState([x for x, _ in pairs], imm.model_probabilities)
        logs = np.log(imm.model_probabilities) + [log for _, log in pairs]
        weights = np.maximum(np.exp(logs - logs.max()), 1e-9)
        imm.model_probabilities = weights / weights.sum()
        return imm


class Tracker:
    def __init__(self):
        kf_list = [ExtendedKalmanFilter(Straight()), ExtendedKalmanFilter(CoordinatedTurn())]
        self.imm_filter = InteractingModelFilter(kf_list, out=0.4, back=0.7)

    def step(self, state, scan):
        model = RadarModel(scan) if scan.kind == "radar" else LidarModel(scan)
        if state is None:
            place, P = model.place(scan.measurement)
            covariance = np.diag([0.0, 0.0, 400.0, 400.0, RATE_SPREAD**2])
            covariance[:2, :2] = P
            x = StateWithCovariance(np.append(place, [0.0, 0.0, 0.0]), covariance, scan.time)
            imm = ImmState([x, x], np.array([0.7, 0.3]))
        else:
            imm = self.imm_filter.predict(state, scan.time)
            if scan.valid:
                imm = self.imm_filter.correct(imm, scan.measurement, model)
        x = gaussian_mixing(imm.model_probabilities, imm.model_states)
        P = x.covariance[:4, :4]
        return imm, (x.value[:4], 0.5 * (P + P.T))
