"""Constant turn rate and acceleration, in the manner of a script: X = [x; y; psi; v; omega; a], Jacobians by hand."""

from numpy import arctan2, array, cos, diag, eye, hypot, pi, sin, sqrt, zeros
from numpy.linalg import inv

sGPSacc, sTurn = 3.0, 0.5  # jerk m/s^3, yaw acceleration rad/s^2 (densities)


def f_ctra(X, T):
    x, y, psi, v, w, a = X
    if abs(w) > 1e-3:
        p1 = psi + w * T
        x1 = x + ((v * w + a * w * T) * sin(p1) + a * cos(p1) - v * w * sin(psi) - a * cos(psi)) / w**2
        y1 = y + ((-v * w - a * w * T) * cos(p1) + a * sin(p1) + v * w * cos(psi) - a * sin(psi)) / w**2
    else:
        pm = psi + 0.5 * w * T
        x1 = x + (v * T + 0.5 * a * T**2) * cos(pm)
        y1 = y + (v * T + 0.5 * a * T**2) * sin(pm)
    return array([x1, y1, psi + w * T, v + a * T, w, a])


def jac_f(X, T):
    """Of the mean course over the step: what is left out is of the order T^3."""
    _, _, psi, v, w, a = X
    pm = psi + 0.5 * w * T
    d = v * T + 0.5 * a * T**2
    JA = eye(6)
    JA[0, 2] = -d * sin(pm)
    JA[0, 3] = T * cos(pm)
    JA[0, 4] = -0.5 * d * T * sin(pm)
    JA[0, 5] = 0.5 * T**2 * cos(pm)
    JA[1, 2] = d * cos(pm)
    JA[1, 3] = T * sin(pm)
    JA[1, 4] = 0.5 * d * T * cos(pm)
    JA[1, 5] = 0.5 * T**2 * sin(pm)
    JA[2, 4] = T
    JA[3, 5] = T
    return JA


def noise(X, T):
    c, s = cos(X[2]), sin(X[2])
    q = zeros((6, 6))
    # along: position, speed, acceleration
    al = sGPSacc**2 * array([[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]])
    B = zeros((6, 3))
    B[0, 0], B[1, 0], B[3, 1], B[5, 2] = c, s, 1.0, 1.0
    q += B @ al @ B.T
    # across: course and turn rate
    B = zeros((6, 2))
    B[2, 0], B[4, 1] = 1.0, 1.0
    q += sTurn**2 * B @ array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]) @ B.T
    q += diag([1e-6, 1e-6, 1e-8, 1e-8, 1e-8, 1e-8]) * T
    return q


def h_radar(X, scan):
    xs, ys, ps = scan.sensor_pose
    us, vs = scan.sensor_velocity
    dx, dy, psi, v = X[0] - xs, X[1] - ys, X[2], X[3]
    r = hypot(dx, dy)
    vx, vy = v * cos(psi) - us, v * sin(psi) - vs
    rr = (dx * vx + dy * vy) / r
    hx = array([r, arctan2(dy, dx) - ps, rr])
    JH = zeros((3, 6))
    JH[0, 0], JH[0, 1] = dx / r, dy / r
    JH[1, 0], JH[1, 1] = -dy / r**2, dx / r**2
    JH[2, 0], JH[2, 1] = vx / r - dx * rr / r**2, vy / r - dy * rr / r**2
    JH[2, 2] = v * (-dx * sin(psi) + dy * cos(psi)) / r
    JH[2, 3] = (dx * cos(psi) + dy * sin(psi)) / r
    return hx, JH


def h_lidar(X, scan):
    xs, ys, ps = scan.sensor_pose
    dx, dy = X[0] - xs, X[1] - ys
    c, s = cos(ps), sin(ps)
    JH = zeros((2, 6))
    JH[:, :2] = [[c, s], [-s, c]]
    return array([c * dx + s * dy, -s * dx + c * dy]), JH


def ekf(X, P, T, scan):
    # Time Update
    n = max(1, int(T / 0.1 + 0.5))
    for _ in range(n):
        JA = jac_f(X, T / n)
        Q = noise(X, T / n)
        X = f_ctra(X, T / n)
        P = JA @ P @ JA.T + Q
    # Measurement Update
    if scan.valid:
        Z = array(scan.measurement)
        hx, JH = h_radar(X, scan) if scan.kind == "radar" else h_lidar(X, scan)
        e = Z - hx
        if scan.kind == "radar":
            e[1] = (e[1] + pi) % (2 * pi) - pi
        S = JH @ P @ JH.T + scan.noise_covariance
        K = P @ JH.T @ inv(S)
        X = X + K @ e
        P = (eye(6) - K @ JH) @ P
        P = 0.5 * (P + P.T)
    X[2] = (X[2] + pi) % (2 * pi) - pi
    return X, P


def warm_up(m, C, T, scan):
    """A linear filter of x, y, vx, vy until there is a course."""
    A = eye(4) + T * eye(4, k=2)
    G = array([[T**2 / 2, 0], [0, T**2 / 2], [T, 0], [0, T]])
    m, C = A @ m, A @ C @ A.T + 9.0 * G @ G.T
    if scan.valid:
        z, R = place(scan)
        K = C[:, :2] @ inv(C[:2, :2] + R)
        m, C = m + K @ (z - m[:2]), C - K @ C[:2]
    return m, 0.5 * (C + C.T)


def place(scan):
    x, y, p = scan.sensor_pose
    if scan.kind == "radar":
        r, p = scan.measurement[0], p + scan.measurement[1]
        J = array([[cos(p), -r * sin(p)], [sin(p), r * cos(p)]])
        z = array([x, y]) + r * J[:, 0]
    else:
        J = array([[cos(p), -sin(p)], [sin(p), cos(p)]])
        z = array([x, y]) + J @ scan.measurement
    return z, J @ scan.noise_covariance[:2, :2] @ J.T


def take_over(m, C):
    vx, vy = m[2], m[3]
    v = hypot(vx, vy)
    X = array([m[0], m[1], arctan2(vy, vx), v, 0.0, 0.0])
    B = zeros((6, 4))
    B[0, 0] = B[1, 1] = 1.0
    B[2, 2:] = -vy / v**2, vx / v**2
    B[3, 2:] = vx / v, vy / v
    return X, B @ C @ B.T + diag([0, 0, 0, 0, 0.2**2, 1.5**2])


def to_world(X, P):
    psi, v = X[2], X[3]
    J = zeros((4, 6))
    J[0, 0] = J[1, 1] = 1.0
    J[2, 2:4] = -v * sin(psi), cos(psi)
    J[3, 2:4] = v * cos(psi), sin(psi)
    P = J @ P @ J.T + 1e-8 * eye(4)
    return array([X[0], X[1], v * cos(psi), v * sin(psi)]), 0.5 * (P + P.T)


class Tracker:
    def step(self, state, scan):
        if state is None:
            z, R = place(scan)
            C = diag([0.0, 0.0, 400.0, 400.0])
            C[:2, :2] = R
            return (scan.time, array([z[0], z[1], 0.0, 0.0]), C), (array([z[0], z[1], 0.0, 0.0]), C)
        t, X, P = state
        T = scan.time - t
        if len(X) == 6:
            X, P = ekf(X.copy(), P, T, scan)
            return (scan.time, X, P), to_world(X, P)
        X, P = warm_up(X, P, T, scan)
        out = X, P
        if hypot(X[2], X[3]) > 8.0 * sqrt(P[2, 2] + P[3, 3]) and hypot(X[2], X[3]) > 2.0:
            X, P = take_over(X, P)
        return (scan.time, X, P), out
