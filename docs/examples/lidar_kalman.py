import numpy as np

FIRST = np.zeros(4), np.diag([1e6, 1e6, 400, 400])  # anywhere, at up to about 40 m/s


class LidarKalman:
    def step(self, state, scan):
        time, mean, P = state or (scan.time, *FIRST)
        dt = scan.time - time
        F, G = np.eye(4) + dt * np.eye(4, k=2), np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        mean, P = F @ mean, F @ P @ F.T + 9 * G @ G.T  # 3 m/s², constant over a step
        if scan.valid:
            x, y, yaw = scan.sensor_pose
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            z, R = [x, y] + turn @ scan.measurement, turn @ scan.noise_covariance @ turn.T
            K = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
            A = np.eye(4) - K @ np.eye(2, 4)
            mean, P = mean + K @ (z - mean[:2]), A @ P @ A.T + K @ R @ K.T
        return (scan.time, mean, P), (mean, P)
