"""A Kalman filter of functions, whose state is a dict; measurements are turned into the world first."""

import numpy as np

ACCELERATION = 3.0  # m/s^2
START_SPEED = 25.0  # m/s, standard deviation of each component where nothing is known


def block(a, b):
    out = np.zeros((4, 4))
    out[:2, :2], out[2:, 2:] = a, b
    return out


def white_noise(dt, var):
    """Of a position and its velocity."""
    return var * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])


def transition(dt):
    """Of x, vx, y, vy."""
    one = np.array([[1.0, dt], [0.0, 1.0]])
    return block(one, one)


def to_world(scan):
    """z, H and R; of a radar z has the speed along the ray."""
    m, R = scan.measurement, scan.noise_covariance
    ex, ey, yaw = scan.sensor_pose
    H = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
    if scan.kind == "lidar":
        c, s = np.cos(yaw), np.sin(yaw)
        J = np.array([[c, -s], [s, c]])
        return np.array([ex, ey]) + J @ m, H, J @ R @ J.T
    r, azimuth, rate = m
    c, s = np.cos(yaw + azimuth), np.sin(yaw + azimuth)
    ground = rate + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
    z = np.array([ex + r * c, ey + r * s, ground])
    J = np.array([[c, -r * s, 0], [s, r * c, 0], [0, 0, 1.0]])
    R = J @ R @ J.T
    R[2, 2] += 0.12**2  # the ray is that of the measured azimuth
    return z, np.vstack([H, [0, c, 0, s]]), R


def start(scan):
    z, _, R = to_world(scan)
    P = np.diag([0.0, START_SPEED**2, 0.0, START_SPEED**2])
    P[np.ix_([0, 2], [0, 2])] = R[:2, :2]
    return {"stamp": millis(scan.time), "x": np.array([z[0], 0.0, z[1], 0.0]), "P": P}


def millis(seconds):
    return 1000.0 * seconds


def predict(track, dt):
    F = transition(dt)
    Q = block(white_noise(dt, ACCELERATION**2), white_noise(dt, ACCELERATION**2))
    return F @ track["x"], F @ track["P"] @ F.T + Q


def update(x, P, z, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    L = np.eye(4) - K @ H
    x = x + K @ (z - H @ x)
    P = L @ P @ L.T + K @ R @ K.T
    return x, P


def output(x, P):
    """In the order px, py, vx, vy."""
    order = [0, 2, 1, 3]
    P = P[np.ix_(order, order)]
    return x[order], (P + P.T) / 2


class Tracker:
    def step(self, state, scan):
        if state is None:
            track = start(scan)
        else:
            stamp = millis(scan.time)
            dt = (stamp - state["stamp"]) / 1000.0
            x, P = predict(state, dt)
            if scan.valid:
                x, P = update(x, P, *to_world(scan))
            track = {"stamp": stamp, "x": x, "P": P}
        return track, output(track["x"], track["P"])
