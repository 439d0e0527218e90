"""No arrays inside: lists of numbers and loops, as one writes it for a language without matrices. Joseph's form."""

import math

import numpy as np


def mul(A, B):
    return [[sum(a * b for a, b in zip(row, column, strict=True)) for column in zip(*B, strict=True)] for row in A]


def tr(A):
    return [list(column) for column in zip(*A, strict=True)]


def add(A, B):
    return [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(A, B, strict=True)]


def inverse(S):
    (a, b), (c, d) = S
    det = a * d - b * c
    return [[d / det, -b / det], [-c / det, a / det]]


class Tracker:
    def step(self, state, scan):
        if state is None:
            z, R = self.position(scan)
            x = [[z[0]], [z[1]], [0.0], [0.0]]
            P = [[*R[0], 0.0, 0.0], [*R[1], 0.0, 0.0], [0.0, 0.0, 400.0, 0.0], [0.0, 0.0, 0.0, 400.0]]
        else:
            time, x, P = state
            dt = scan.time - time
            F = [[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]]
            G = [[3 * dt**2 / 2, 0], [0, 3 * dt**2 / 2], [3 * dt, 0], [0, 3 * dt]]
            x, P = mul(F, x), add(mul(mul(F, P), tr(F)), mul(G, tr(G)))
            if scan.valid:
                z, R = self.position(scan)
                H = [[1, 0, 0, 0], [0, 1, 0, 0]]
                PHt = mul(P, tr(H))
                K = mul(PHt, inverse(add(mul(H, PHt), R)))
                x = add(x, mul(K, [[z[0] - x[0][0]], [z[1] - x[1][0]]]))
                KH = mul(K, H)
                A = [[(i == j) - KH[i][j] for j in range(4)] for i in range(4)]
                P = add(mul(mul(A, P), tr(A)), mul(mul(K, R), tr(K)))
        P = [[(P[i][j] + P[j][i]) / 2 for j in range(4)] for i in range(4)]
        return (scan.time, x, P), (np.array(x)[:, 0], np.array(P))

    def position(self, scan):
        x, y, yaw = map(float, scan.sensor_pose)
        m = [float(value) for value in scan.measurement]
        radar = scan.kind == "radar"
        r, angle = (m[0], yaw + m[1]) if radar else (1.0, yaw)
        c, s = math.cos(angle), math.sin(angle)
        J = [[c, -r * s], [s, r * c]]
        ahead, left = (r, 0.0) if radar else m
        z = [x + J[0][0] * ahead + J[0][1] * left, y + J[1][0] * ahead + J[1][1] * left]
        noise = [[float(scan.noise_covariance[i, j]) for j in range(2)] for i in range(2)]
        return z, mul(mul(J, noise), tr(J))
