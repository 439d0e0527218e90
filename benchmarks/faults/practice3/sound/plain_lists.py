"""A filter in plain Python, without arrays: nested lists, and one component of a measurement after the other.

A radar's components are the distance along the measured ray, that across it, and the speed along it.
"""

from math import cos, sin


def predict(x, P, dt, q):
    x = [x[0] + dt * x[2], x[1] + dt * x[3], x[2], x[3]]
    A = [[P[i][j] + (dt * P[i + 2][j] if i < 2 else 0.0) for j in range(4)] for i in range(4)]
    P = [[A[i][j] + (dt * A[i][j + 2] if j < 2 else 0.0) for j in range(4)] for i in range(4)]
    for k in range(2):
        P[k][k] += q * dt**4 / 4
        P[k][k + 2] += q * dt**3 / 2
        P[k + 2][k] += q * dt**3 / 2
        P[k + 2][k + 2] += q * dt**2
    return x, P


def take(x, P, z, h, r):
    """One component; Joseph's form, written out."""
    Ph = [sum(P[i][j] * h[j] for j in range(4)) for i in range(4)]
    s = sum(h[i] * Ph[i] for i in range(4)) + r
    k = [p / s for p in Ph]
    y = z - sum(h[i] * x[i] for i in range(4))
    A = [[(1.0 if i == j else 0.0) - k[i] * h[j] for j in range(4)] for i in range(4)]
    AP = [[sum(A[i][n] * P[n][j] for n in range(4)) for j in range(4)] for i in range(4)]
    P = [[sum(AP[i][n] * A[j][n] for n in range(4)) + k[i] * r * k[j] for j in range(4)] for i in range(4)]
    for i in range(4):
        for j in range(i):
            P[i][j] = P[j][i] = (P[i][j] + P[j][i]) / 2
    return [x[i] + k[i] * y for i in range(4)], P


def components(scan, x):
    """Triples of value, row and variance, whose errors are independent."""
    m = [float(v) for v in scan.measurement]
    R = [[float(v) for v in row] for row in scan.noise_covariance]
    px, py, yaw = (float(v) for v in scan.sensor_pose)
    angle = yaw + m[1] if scan.kind == "radar" else yaw
    c, s = cos(angle), sin(angle)
    ray, aside = [c, s, 0.0, 0.0], [-s, c, 0.0, 0.0]
    ahead, left = c * px + s * py, -s * px + c * py
    if scan.kind != "radar":
        return [(m[0] + ahead, ray, R[0][0]), (m[1] + left, aside, R[1][1])]
    vx, vy = (float(v) for v in scan.sensor_velocity)
    # An azimuth that is too large turns the ray and moves the place across it: both by the same error.
    share = (s * (x[2] - vx) - c * (x[3] - vy)) / m[0]
    speed, row = m[2] + c * vx + s * vy, [0.0, 0.0, c, s]
    return [
        (m[0] + ahead, ray, R[0][0]),
        (left, aside, m[0] ** 2 * R[1][1]),
        (speed - share * left, [row[i] - share * aside[i] for i in range(4)], R[2][2]),
    ]


class Tracker:
    q, unknown = 9.0, 400.0

    def step(self, state, scan):
        if state is None:
            x, P = (
                [0.0] * 4,
                [[(1e6 if i < 2 else self.unknown) if i == j else 0.0 for j in range(4)] for i in range(4)],
            )
            for component in components(scan, x)[:2]:
                x, P = take(x, P, *component)
        else:
            time, x, P = state
            x, P = predict(x, P, float(scan.time - time), self.q)
            if scan.valid:
                for component in components(scan, x):
                    x, P = take(x, P, *component)
        return (scan.time, x, P), (x, P)
