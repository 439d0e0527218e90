"""A Kalman filter in the axes of the sensor: where the object is from it, and its velocity over ground.

The axes go along with the car, so that every prediction ends with a change of axes.
"""

import numpy as np


def turned(angle):
    """Rotation by an angle."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def both(T):
    """The same rotation of position and velocity."""
    return np.kron(np.eye(2), T)


class Tracker:
    sigma_long = 3.0
    start_speed = 20.0

    def step(self, state, scan):
        if state is None:
            state = self.begin(scan)
        else:
            state = self.carried(self.predicted(state, scan.time), scan.sensor_pose)
            if scan.valid:
                state = self.corrected(state, scan)
        return state, self.in_fixed_frame(state)

    def begin(self, scan):
        P = np.zeros((4, 4))
        if scan.kind == "radar":
            r, a = scan.measurement[:2]
            J = np.array([[np.cos(a), -r * np.sin(a)], [np.sin(a), r * np.cos(a)]])
            place = np.array([r * np.cos(a), r * np.sin(a)])
            P[:2, :2] = J @ scan.noise_covariance[:2, :2] @ J.T
        else:
            place = scan.measurement
            P[:2, :2] = scan.noise_covariance
        P[2, 2] = P[3, 3] = self.start_speed**2
        return {"t": scan.time, "pose": scan.sensor_pose, "x": np.array([*place, 0.0, 0.0]), "P": P}

    def predicted(self, state, t):
        dt = t - state["t"]
        F = np.eye(4)
        F[:2, 2:] = dt * np.eye(2)
        B = np.concatenate([0.5 * dt**2 * np.eye(2), dt * np.eye(2)])
        Q = B @ B.T * self.sigma_long**2
        return {**state, "t": t, "x": F @ state["x"], "P": F @ state["P"] @ F.T + Q}

    def carried(self, state, pose):
        """Into the axes of the sensor where it is now."""
        old = state["pose"]
        moved = turned(-old[2]) @ (pose[:2] - old[:2])
        yaw = pose[2] - old[2]
        T = both(turned(-yaw))
        x = state["x"].copy()
        x[:2] -= moved
        return {**state, "pose": pose, "x": T @ x, "P": T @ state["P"] @ T.T}

    def corrected(self, state, scan):
        x, P = state["x"], state["P"]
        if scan.kind == "radar":
            own = turned(-scan.sensor_pose[2]) @ scan.sensor_velocity
            r = np.hypot(x[0], x[1])
            ray = x[:2] / r
            side = np.array([-ray[1], ray[0]])
            ego = ray @ own
            closing = ray @ x[2:] - ego
            gap = scan.measurement - np.array([r, np.arctan2(x[1], x[0]), closing])
            gap[1] = np.remainder(gap[1] + np.pi, 2 * np.pi) - np.pi
            H = np.zeros((3, 4))
            H[0, :2] = ray
            H[1, :2] = side / r
            H[2, :2] = side * (side @ (x[2:] - own)) / r
            H[2, 2:] = ray
        else:
            H = np.eye(2, 4)
            gap = scan.measurement - x[:2]
        R = scan.noise_covariance
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        L = np.eye(4) - K @ H
        return {**state, "x": x + K @ gap, "P": L @ P @ L.T + K @ R @ K.T}

    def in_fixed_frame(self, state):
        T = both(turned(state["pose"][2]))
        mean = T @ state["x"]
        mean[:2] += state["pose"][:2]
        return mean, T @ state["P"] @ T.T
