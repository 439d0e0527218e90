"""One long function over arrays of tracks, short names, the smallest distance first."""

import numpy as np

G = {2: 15.0, 3: 17.5}
TL, TD = 0.3, 1.0  # s without a detection, before and after confirmation
NH = 3


def h_of(x, k, s, sv):
    dx, dy, a = x[0] - s[0], x[1] - s[1], s[2]
    if k == "lidar":
        c, n = np.cos(a), np.sin(a)
        return np.array([c * dx + n * dy, c * dy - n * dx]), np.array([[c, n, 0, 0], [-n, c, 0, 0]])
    r = max(np.sqrt(dx * dx + dy * dy), 0.5)
    c, n = dx / r, dy / r
    u, v = x[2] - sv[0], x[3] - sv[1]
    w = (c * v - n * u) / r
    return (
        np.array([r, np.arctan2(dy, dx) - a, c * u + n * v]),
        np.array([[c, n, 0, 0], [-n / r, c / r, 0, 0], [-n * w, c * w, c, n]]),
    )


def loop(m, t, k, Z, R, s, sv):
    """m is the memory: X, P, hits, time of the last detection, ids, next id, time."""
    X, P, nh, tl, ids, nid, tp = m
    X, P, nh, tl, ids = X.copy(), P.copy(), nh.copy(), tl.copy(), ids.copy()
    dt = t - tp
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    b = np.array([dt * dt / 2, dt])
    Q = 2.5**2 * np.kron(np.outer(b, b), np.eye(2)) + 0.3 * dt * np.diag([0, 0, 1, 1])
    for i in range(len(X)):
        X[i] = F @ X[i]
        P[i] = F @ P[i] @ F.T + Q
    # distances
    D, U = [], {}
    for i in range(len(X)):
        h, H = h_of(X[i], k, s, sv)
        S = H @ P[i] @ H.T + R
        Si = np.linalg.inv(S)
        for j in range(len(Z)):
            y = Z[j] - h
            if k == "radar":
                y[1] = np.arctan2(np.sin(y[1]), np.cos(y[1]))
            d = y @ Si @ y
            if d < G[len(y)]:
                D.append((d + np.log(np.linalg.det(S)), i, j))
                U[i, j] = y, H, Si
    D.sort()
    ti, tj = set(), set()
    for _, i, j in D:
        if i in ti or j in tj:
            continue
        ti.add(i)
        tj.add(j)
        y, H, Si = U[i, j]
        K = P[i] @ H.T @ Si
        X[i] = X[i] + K @ y
        A = np.eye(4) - K @ H
        P[i] = A @ P[i] @ A.T + K @ R @ K.T
        nh[i] += 1
        tl[i] = t
        if ids[i] < 0 and nh[i] >= NH:
            ids[i] = nid
            nid += 1
    # deaths
    keep = t - tl <= np.where(ids < 0, TL, TD)
    X, P, nh, tl, ids = X[keep], P[keep], nh[keep], tl[keep], ids[keep]
    # births
    for j in range(len(Z)):
        if j in tj:
            continue
        r, a = (Z[j][0], s[2] + Z[j][1]) if k == "radar" else (1.0, s[2])
        c, n = np.cos(a), np.sin(a)
        J = np.array([[c, -r * n], [n, r * c]])
        x = np.zeros(4)
        x[:2] = s[:2] + (J @ Z[j] if k == "lidar" else J[:, 0] * r)
        p = np.diag([0.0, 0.0, 450.0, 450.0])
        p[:2, :2] = J @ R[:2, :2] @ J.T
        X, P = np.concatenate([X, x[None]]), np.concatenate([P, p[None]])
        nh, tl, ids = np.append(nh, 1), np.append(tl, t), np.append(ids, -1)
    return X, P, nh, tl, ids, nid, t


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        if state is None:
            none = np.zeros(0, dtype=int)
            state = np.zeros((0, 4)), np.zeros((0, 4, 4)), none, np.zeros(0), none, 0, scan.time
        Z = scan.measurement.T
        state = loop(state, scan.time, scan.kind, Z, scan.noise_covariance, scan.sensor_pose, scan.sensor_velocity)
        X, P, _, _, ids, _, _ = state
        i = ids >= 0
        if not i.any():
            return state, None
        return state, (ids[i], X[i].T, np.moveaxis(P[i], 0, 2))
