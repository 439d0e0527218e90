"""A library of linear Gaussian models for whole sequences, with an update for one step, and an adapter over it."""

import numpy as np
from numpy import ma


def _filter_predict(
    transition_matrix,
    transition_covariance,
    transition_offset,
    current_state_mean,
    current_state_covariance,
):
    predicted_state_mean = np.dot(transition_matrix, current_state_mean) + transition_offset
    predicted_state_covariance = (
        np.dot(transition_matrix, np.dot(current_state_covariance, transition_matrix.T)) + transition_covariance
    )
    return predicted_state_mean, predicted_state_covariance


def _filter_correct(
    observation_matrix,
    observation_covariance,
    observation_offset,
    predicted_state_mean,
    predicted_state_covariance,
    observation,
):
    if np.any(ma.getmaskarray(observation)):
        n_dim_state, n_dim_obs = len(predicted_state_mean), len(observation)
        return np.zeros((n_dim_state, n_dim_obs)), predicted_state_mean, predicted_state_covariance
    predicted_observation_mean = np.dot(observation_matrix, predicted_state_mean) + observation_offset
    predicted_observation_covariance = (
        np.dot(observation_matrix, np.dot(predicted_state_covariance, observation_matrix.T)) + observation_covariance
    )
    kalman_gain = np.dot(
        predicted_state_covariance,
        np.dot(observation_matrix.T, np.linalg.pinv(predicted_observation_covariance)),
    )
    innovation = np.asarray(observation) - predicted_observation_mean
    corrected_state_mean = predicted_state_mean + np.dot(kalman_gain, innovation)
    corrected_state_covariance = predicted_state_covariance - np.dot(
        kalman_gain, np.dot(observation_matrix, predicted_state_covariance)
    )
    return kalman_gain, corrected_state_mean, corrected_state_covariance


def _first_given(*values):
    return next(value for value in values if value is not None)


class KalmanFilter:
    """What is not given is taken from the constructor, and what is not given there from the dimensions."""

    def __init__(
        self,
        transition_matrices=None,
        observation_matrices=None,
        transition_covariance=None,
        observation_covariance=None,
        n_dim_state=4,
        n_dim_obs=2,
    ):
        self.transition_matrices = transition_matrices
        self.observation_matrices = observation_matrices
        self.transition_covariance = transition_covariance
        self.observation_covariance = observation_covariance
        self.n_dim_state, self.n_dim_obs = n_dim_state, n_dim_obs

    def _initialize_parameters(self):
        return (
            _first_given(self.transition_matrices, np.eye(self.n_dim_state)),
            np.zeros(self.n_dim_state),
            _first_given(self.transition_covariance, np.eye(self.n_dim_state)),
            _first_given(self.observation_matrices, np.eye(self.n_dim_obs, self.n_dim_state)),
            np.zeros(self.n_dim_obs),
            _first_given(self.observation_covariance, np.eye(self.n_dim_obs)),
        )

    def filter_update(
        self,
        filtered_state_mean,
        filtered_state_covariance,
        observation=None,
        transition_matrix=None,
        transition_offset=None,
        transition_covariance=None,
        observation_matrix=None,
        observation_offset=None,
        observation_covariance=None,
    ):
        defaults = self._initialize_parameters()
        transition_matrix = _first_given(transition_matrix, defaults[0])
        transition_offset = _first_given(transition_offset, defaults[1])
        transition_covariance = _first_given(transition_covariance, defaults[2])
        observation_matrix = _first_given(observation_matrix, defaults[3])
        observation_offset = _first_given(observation_offset, defaults[4])
        observation_covariance = _first_given(observation_covariance, defaults[5])
        predicted_state_mean, predicted_state_covariance = _filter_predict(
            transition_matrix,
            transition_covariance,
            transition_offset,
            filtered_state_mean,
            filtered_state_covariance,
        )
        if observation is None:
            observation = ma.masked_all(len(observation_matrix))
        _, mean, covariance = _filter_correct(
            observation_matrix,
            observation_covariance,
            observation_offset,
            predicted_state_mean,
            predicted_state_covariance,
            observation,
        )
        return mean, covariance


class Observed:
    """A scan in what the library takes: linear in the state, with an offset and a covariance."""

    def __init__(self, scan):
        self.seen = bool(scan.valid)
        ex, ey, yaw = scan.sensor_pose
        z = np.asarray(scan.measurement)
        c, s = np.cos(yaw), np.sin(yaw)
        self.matrix = np.array([[c, s, 0, 0], [-s, c, 0, 0]])
        self.offset = -self.matrix[:, :2] @ [ex, ey]
        self.value, self.covariance = z, np.asarray(scan.noise_covariance)
        if scan.kind == "radar":
            r, a, rate = z if self.seen else (1.0, 0.0, 0.0)
            ca, sa = np.cos(a), np.sin(a)
            J = np.array([[ca, -r * sa, 0.0], [sa, r * ca, 0.0], [0.0, 0.0, 1.0]])
            ray = np.array([c * ca - s * sa, s * ca + c * sa])
            self.matrix = np.vstack([self.matrix, [0.0, 0.0, *ray]])
            self.offset = np.append(self.offset, -(ray @ scan.sensor_velocity))
            self.value = np.array([r * ca, r * sa, rate])
            self.covariance = J @ scan.noise_covariance @ J.T + np.diag([0.0, 0.0, 0.15**2])

    def place(self):
        C, R = self.matrix[:2, :2], self.covariance[:2, :2]
        return C.T @ (self.value[:2] - self.offset[:2]), C.T @ R @ C


class Tracker:
    accel = 3.0

    def __init__(self):
        self.kf = KalmanFilter(n_dim_state=4, n_dim_obs=2)

    def step(self, state, scan):
        seen = Observed(scan)
        if state is None:
            place, R = seen.place()
            mean = np.array([*place, 0.0, 0.0])
            covariance = np.diag([0.0, 0.0, 400.0, 400.0])
            covariance[:2, :2] = R
        else:
            last, mean, covariance = state
            dt = scan.time - last
            G = self.accel * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
            mean, covariance = self.kf.filter_update(
                mean,
                covariance,
                observation=ma.asarray(seen.value) if seen.seen else None,
                transition_matrix=np.eye(4) + dt * np.eye(4, k=2),
                transition_covariance=G @ G.T,
                observation_matrix=seen.matrix,
                observation_offset=seen.offset,
                observation_covariance=seen.covariance,
            )
            covariance = (covariance + covariance.T) / 2
        return (scan.time, mean, covariance), (mean, covariance)
