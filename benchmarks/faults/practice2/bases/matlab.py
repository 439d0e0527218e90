"""From a script in MATLAB: the state is x, vx, y, vy in metres and km/h, angles are in degrees."""

import numpy as np

KMH = 3.6
ORDER = [0, 2, 1, 3]  # to px, py, vx, vy
SCALE = np.array([1.0, 1.0, 1 / KMH, 1 / KMH])


def cosd(a):
    return np.cos(np.radians(a))


def sind(a):
    return np.sin(np.radians(a))


def ssa(angle, unit="rad"):
    """The smallest signed angle."""
    if unit == "deg":
        return (angle + 180.0) % 360.0 - 180.0
    return (angle + np.pi) % (2 * np.pi) - np.pi


def blkdiag(A, B):
    out = np.zeros((A.shape[0] + B.shape[0], A.shape[1] + B.shape[1]))
    out[: A.shape[0], : A.shape[1]] = A
    out[A.shape[0] :, A.shape[1] :] = B
    return out


def time_update(x, P, h, sigma_a):
    """h: seconds since the last one."""
    A1 = np.array([[1.0, h / KMH], [0.0, 1.0]])
    E1 = np.array([[h**2 / 2], [h * KMH]])
    A, E = blkdiag(A1, A1), blkdiag(E1, E1)
    return A @ x, A @ P @ A.T + sigma_a**2 * E @ E.T


def radar(x, sensor):
    dx, dy = x[0] - sensor["x"], x[2] - sensor["y"]
    ux, uy = x[1] - sensor["vx"], x[3] - sensor["vy"]
    r = np.hypot(dx, dy)
    c, s = dx / r, dy / r
    rate = (c * ux + s * uy) / KMH
    h = np.array([r, np.degrees(np.arctan2(dy, dx)) - sensor["psi"], rate])
    w = (c * uy - s * ux) / KMH / r
    H = np.array([[c, 0, s, 0], [np.degrees(-s / r), 0, np.degrees(c / r), 0], [-s * w, c / KMH, c * w, s / KMH]])
    return h, H


def laser(x, sensor):
    c, s = cosd(sensor["psi"]), sind(sensor["psi"])
    H = np.array([[c, 0, s, 0], [-s, 0, c, 0]])
    return H @ (x - np.array([sensor["x"], 0, sensor["y"], 0])), H


def measurement_update(x, P, z, R, sensor):
    if sensor["type"] == "radar":
        h, H = radar(x, sensor)
        eps = z - h
        eps[1] = ssa(eps[1], "deg")
    else:
        h, H = laser(x, sensor)
        eps = z - h
    K = P @ H.T / 1.0 @ np.linalg.inv(H @ P @ H.T + R)
    IKC = np.eye(4) - K @ H
    return x + K @ eps, IKC @ P @ IKC.T + K @ R @ K.T


def initial(z, R, sensor):
    psi = sensor["psi"]
    if sensor["type"] == "radar":
        a = psi + z[1]
        pos = z[0] * np.array([cosd(a), sind(a)])
        J = np.array([[cosd(a), -z[0] * sind(a) * np.pi / 180], [sind(a), z[0] * cosd(a) * np.pi / 180]])
    else:
        J = np.array([[cosd(psi), -sind(psi)], [sind(psi), cosd(psi)]])
        pos = J @ z
    x = np.array([sensor["x"] + pos[0], 0.0, sensor["y"] + pos[1], 0.0])
    P = np.diag([0.0, 70.0**2, 0.0, 70.0**2])
    P[np.ix_([0, 2], [0, 2])] = J @ R[:2, :2] @ J.T
    return x, P


class Tracker:
    sigma_a = 3.0

    def step(self, state, scan):
        sensor, z, R = self.inputs(scan)
        if state is None:
            x, P = initial(z, R, sensor)
        else:
            x, P, t = state
            x, P = time_update(x, P, scan.time - t, self.sigma_a)
            if scan.valid:
                x, P = measurement_update(x, P, z, R, sensor)
        mean = x[ORDER] * SCALE
        covariance = P[np.ix_(ORDER, ORDER)] * np.outer(SCALE, SCALE)
        return (x, P, scan.time), (mean, (covariance + covariance.T) / 2)

    def inputs(self, scan):
        z, R = scan.measurement.copy(), scan.noise_covariance.copy()
        if scan.kind == "radar":
            D = np.diag([1.0, 180 / np.pi, 1.0])
            z, R = D @ z, D @ R @ D
        vx, vy = scan.sensor_velocity * KMH
        x, y, psi = scan.sensor_pose
        return {"type": scan.kind, "x": x, "y": y, "psi": np.degrees(psi), "vx": vx, "vy": vy}, z, R
