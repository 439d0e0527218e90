"""Ported from MATLAB: straight on, to the left, to the right; structures of arrays, measurements by single numbers."""

import numpy as np

RATES = [0.0, 0.22, -0.22]  # rad/s
SIGMAS = [1.0, 2.0, 2.0]  # m/s^2
PI = np.array([[0.96, 0.02, 0.02], [0.04, 0.95, 0.01], [0.04, 0.01, 0.95]])  # from the row to the column


def normpdf(x, mu, sigma):
    return np.exp(-0.5 * ((x - mu) / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)


def turn(w, T):
    if abs(w) < 1e-6:
        return np.eye(4) + T * np.eye(4, k=2)
    s, c = np.sin(w * T), np.cos(w * T)
    return np.array([[1, 0, s / w, (c - 1) / w], [0, 1, (1 - c) / w, s / w], [0, 0, c, -s], [0, 0, s, c]])


def model(j, T):
    G = np.vstack([T**2 / 2 * np.eye(2), T * np.eye(2)])
    return turn(RATES[j], T), SIGMAS[j] ** 2 * G @ G.T


def reinit(imm):
    """Normalising constants, and the mixed states and covariances; columns are models."""
    M = len(imm["mu"])
    cbar = np.zeros(M)
    mix = np.zeros((M, M))
    for j in range(M):
        for i in range(M):
            cbar[j] += PI[i, j] * imm["mu"][i]
    for i in range(M):
        for j in range(M):
            mix[i, j] = PI[i, j] * imm["mu"][i] / cbar[j]
    x0 = np.zeros((4, M))
    P0 = np.zeros((4, 4, M))
    for j in range(M):
        for i in range(M):
            x0[:, j] += mix[i, j] * imm["x"][:, i]
        for i in range(M):
            d = imm["x"][:, i] - x0[:, j]
            P0[:, :, j] += mix[i, j] * (imm["P"][:, :, i] + np.outer(d, d))
    return cbar, x0, P0


def predict(imm, T):
    cbar, x0, P0 = reinit(imm)
    x, P = np.empty_like(x0), np.empty_like(P0)
    for j in range(len(cbar)):
        A, Q = model(j, T)
        x[:, j] = A @ x0[:, j]
        P[:, :, j] = A @ P0[:, :, j] @ A.T + Q
    return {"mu": cbar, "x": x, "P": P}


def rows(x, sensor):
    """What the sensor would measure, and its derivatives."""
    dx, dy = x[0] - sensor["pose"][0], x[1] - sensor["pose"][1]
    yaw = sensor["pose"][2]
    if sensor["kind"] == "lidar":
        c, s = np.cos(yaw), np.sin(yaw)
        return np.array([c * dx + s * dy, c * dy - s * dx]), np.array([[c, s, 0, 0], [-s, c, 0, 0]])
    ux, uy = x[2] - sensor["velocity"][0], x[3] - sensor["velocity"][1]
    r = np.hypot(dx, dy)
    c, s = dx / r, dy / r
    w = (c * uy - s * ux) / r
    h = np.array([r, np.arctan2(dy, dx) - yaw, c * ux + s * uy])
    return h, np.array([[c, s, 0, 0], [-s / r, c / r, 0, 0], [-s * w, c * w, c, s]])


def update(imm, z, R, sensor):
    mu, x, P = imm["mu"].copy(), imm["x"].copy(), imm["P"].copy()
    for j in range(len(mu)):
        xj, Pj = x[:, j], P[:, :, j]
        h, H = rows(xj, sensor)
        nu = z - h
        if sensor["kind"] == "radar":
            nu[1] = np.mod(nu[1] + np.pi, 2 * np.pi) - np.pi
        dxj = np.zeros(4)
        lik = 1.0
        for k in range(len(z)):
            e = nu[k] - H[k] @ dxj
            s = H[k] @ Pj @ H[k] + R[k, k]
            lik = lik * normpdf(e, 0.0, np.sqrt(s))
            W = Pj @ H[k] / s
            dxj = dxj + W * e
            Pj = Pj - np.outer(W, W) * s
        x[:, j] = xj + dxj
        P[:, :, j] = (Pj + Pj.T) / 2
        mu[j] = mu[j] * lik + 1e-300
    return {"mu": mu / np.sum(mu), "x": x, "P": P}


def output(imm):
    mean = imm["x"] @ imm["mu"]
    cov = np.zeros((4, 4))
    for j, mu in enumerate(imm["mu"]):
        d = imm["x"][:, j] - mean
        cov += mu * (imm["P"][:, :, j] + np.outer(d, d))
    return mean, cov


def initial(z, R, sensor):
    ex, ey, yaw = sensor["pose"]
    radar = sensor["kind"] == "radar"
    r, a = (z[0], yaw + z[1]) if radar else (1.0, yaw)
    J = np.array([[np.cos(a), -r * np.sin(a)], [np.sin(a), r * np.cos(a)]])
    local = np.array([r, 0.0]) if radar else z
    P = np.diag([0.0, 0.0, 400.0, 400.0])
    P[:2, :2] = J @ R[:2, :2] @ J.T
    x = np.concatenate([[ex, ey] + J @ local, [0.0, 0.0]])
    return {"mu": np.array([0.8, 0.1, 0.1]), "x": np.tile(x[:, None], 3), "P": np.tile(P[:, :, None], 3)}


class Tracker:
    def step(self, state, scan):
        z, R = scan.measurement, scan.noise_covariance
        sensor = {"kind": scan.kind, "pose": scan.sensor_pose, "velocity": scan.sensor_velocity}
        if state is None:
            imm = initial(z, R, sensor)
        else:
            t, imm = state
            imm = predict(imm, scan.time - t)
            if scan.valid:
                imm = update(imm, z, R, sensor)
        return (scan.time, imm), output(imm)
