"""An embedded filter carried over from C: flat arrays by rows, ticks of a clock, iterated updates."""

import math

N = 4
BOOT_TICK = 600_000_000  # milliseconds of up time at the first scan


def mat_mul(a, b, n, k, m, out):
    for i in range(n):
        for j in range(m):
            total = 0.0
            for o in range(k):
                total += a[i * k + o] * b[o * m + j]
            out[i * m + j] = total


def mat_trans(a, n, m, out):
    """a has n rows and m columns."""
    for i in range(n):
        for j in range(m):
            out[j * n + i] = a[i * m + j]


def mat_inv(a, n, out):
    """Gauss and Jordan, with pivots."""
    w = list(a)
    for i in range(n * n):
        out[i] = 1.0 if i % (n + 1) == 0 else 0.0
    for col in range(n):
        best = max(range(col, n), key=lambda row: abs(w[row * n + col]))
        for k in range(n):
            w[col * n + k], w[best * n + k] = w[best * n + k], w[col * n + k]
            out[col * n + k], out[best * n + k] = out[best * n + k], out[col * n + k]
        pivot = w[col * n + col]
        for k in range(n):
            w[col * n + k] /= pivot
            out[col * n + k] /= pivot
        for row in range(n):
            if row == col:
                continue
            factor = w[row * n + col]
            for k in range(n):
                w[row * n + k] -= factor * w[col * n + k]
                out[row * n + k] -= factor * out[col * n + k]


def mat_set(out, *values):
    """As many of the values as there is room for."""
    for i in range(min(len(out), len(values))):
        out[i] = float(values[i])


class kalman_t:
    __slots__ = ("P", "tick", "x")

    def __init__(self):
        self.x = [0.0] * N
        self.P = [0.0] * (N * N)
        self.tick = 0

    def copy(self):
        other = kalman_t()
        other.x, other.P, other.tick = list(self.x), list(self.P), self.tick
        return other


def tick_now(seconds):
    return BOOT_TICK + seconds * 1000.0


def kalman_init(kf, scan):
    ex, ey, yaw = (float(v) for v in scan.sensor_pose)
    R = [float(scan.noise_covariance[i][j]) for i in (0, 1) for j in (0, 1)]
    z = [float(v) for v in scan.measurement]
    J, Jt, JR, C = [0.0] * 4, [0.0] * 4, [0.0] * 4, [0.0] * 4
    if scan.kind == "radar":
        c, s = math.cos(yaw + z[1]), math.sin(yaw + z[1])
        mat_set(J, c, -z[0] * s, s, z[0] * c)
        mat_set(kf.x, ex + z[0] * c, ey + z[0] * s, 0, 0)
    else:
        c, s = math.cos(yaw), math.sin(yaw)
        mat_set(J, c, -s, s, c)
        mat_set(kf.x, ex + c * z[0] - s * z[1], ey + s * z[0] + c * z[1], 0, 0)
    mat_trans(J, 2, 2, Jt)
    mat_mul(J, R, 2, 2, 2, JR)
    mat_mul(JR, Jt, 2, 2, 2, C)
    mat_set(kf.P, C[0], C[1], 0, 0, C[2], C[3], 0, 0, 0, 0, 400, 0, 0, 0, 0, 400)
    kf.tick = tick_now(float(scan.time))


def kalman_predict(kf, tick, accel=3.0):
    if tick <= kf.tick:
        return
    dt = float(tick - kf.tick) / 1000.0
    kf.tick = tick
    F, Ft, FP, x = [0.0] * (N * N), [0.0] * (N * N), [0.0] * (N * N), [0.0] * N
    mat_set(F, 1, 0, dt, 0, 0, 1, 0, dt, 0, 0, 1, 0, 0, 0, 0, 1)
    mat_mul(F, kf.x, N, N, 1, x)
    mat_trans(F, N, N, Ft)
    mat_mul(F, kf.P, N, N, N, FP)
    mat_mul(FP, Ft, N, N, N, kf.P)
    v = accel * accel * dt * dt
    pp, pv = v * dt * dt / 4.0, v * dt / 2.0
    for axis in (0, 1):
        kf.P[axis * N + axis] += pp
        kf.P[axis * N + axis + 2] += pv
        kf.P[(axis + 2) * N + axis] += pv
        kf.P[(axis + 2) * N + axis + 2] += v
    kf.x = x


def observe(kf, scan, e, H):
    """Fills innovation and Jacobian, and returns how many there are."""
    ex, ey, yaw = (float(v) for v in scan.sensor_pose)
    z = [float(v) for v in scan.measurement]
    dx, dy = kf.x[0] - ex, kf.x[1] - ey
    if scan.kind != "radar":
        c, s = math.cos(yaw), math.sin(yaw)
        mat_set(H, c, s, 0, 0, -s, c, 0, 0)
        mat_set(e, z[0] - (c * dx + s * dy), z[1] - (-s * dx + c * dy))
        return 2
    u, w = kf.x[2] - float(scan.sensor_velocity[0]), kf.x[3] - float(scan.sensor_velocity[1])
    r = max(math.sqrt(dx * dx + dy * dy), 0.1)
    rr = (dx * u + dy * w) / r
    mat_set(
        H,
        *(dx / r, dy / r, 0, 0),
        *(-dy / (r * r), dx / (r * r), 0, 0),
        *((u - rr * dx / r) / r, (w - rr * dy / r) / r, dx / r, dy / r),
    )
    gap = z[1] - (math.atan2(dy, dx) - yaw)
    mat_set(e, z[0] - r, math.atan2(math.sin(gap), math.cos(gap)), z[2] - rr)
    return 3


def kalman_correct(kf, scan, passes=3):
    e, H = [0.0] * 3, [0.0] * (3 * N)
    prior = list(kf.x)
    for _ in range(passes):
        m = observe(kf, scan, e, H)
        R = [float(scan.noise_covariance[i][j]) for i in range(m) for j in range(m)]
        Ht, PHt, S, Si, K = [0.0] * (N * m), [0.0] * (N * m), [0.0] * (m * m), [0.0] * (m * m), [0.0] * (N * m)
        mat_trans(H, m, N, Ht)
        mat_mul(kf.P, Ht, N, N, m, PHt)
        mat_mul(H, PHt, m, N, m, S)
        for i in range(m * m):
            S[i] += R[i]
        mat_inv(S, m, Si)
        mat_mul(PHt, Si, N, m, m, K)
        for i in range(m):
            for j in range(N):
                e[i] -= H[i * N + j] * (prior[j] - kf.x[j])
        dx = [0.0] * N
        mat_mul(K, e, N, m, 1, dx)
        for i in range(N):
            kf.x[i] = prior[i] + dx[i]
    KH, KHP = [0.0] * (N * N), [0.0] * (N * N)
    mat_mul(K, H, N, m, N, KH)
    mat_mul(KH, kf.P, N, N, N, KHP)
    for i in range(N * N):
        kf.P[i] -= KHP[i]
    for i in range(N):
        for j in range(i):
            kf.P[i * N + j] = kf.P[j * N + i] = 0.5 * (kf.P[i * N + j] + kf.P[j * N + i])


class Tracker:
    def step(self, state, scan):
        if state is None:
            kf = kalman_t()
            kalman_init(kf, scan)
        else:
            kf = state.copy()
            kalman_predict(kf, tick_now(float(scan.time)))
            if scan.valid:
                kalman_correct(kf, scan)
        return kf, (list(kf.x), [kf.P[i * N : i * N + N] for i in range(N)])
