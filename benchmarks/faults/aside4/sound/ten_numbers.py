"""As for a microcontroller: the covariance is ten numbers, every sum is written out, and there is no inverse."""

from math import cos, hypot, pi, sin

import numpy as np

# P: 0 xx, 1 xy, 2 xu, 3 xv, 4 yy, 5 yu, 6 yv, 7 uu, 8 uv, 9 vv
ACC_VAR = 9.0


def kf_predict(s, p, dt):
    d2 = dt * dt
    q_pp, q_pv, q_vv = ACC_VAR * d2 * d2 / 4, ACC_VAR * d2 * dt / 2, ACC_VAR * d2
    x, y, u, v = s
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
    return (x + dt * u, y + dt * v, u, v), (
        p00 + 2 * dt * p02 + d2 * p22 + q_pp,
        p01 + dt * (p03 + p12) + d2 * p23,
        p02 + dt * p22 + q_pv,
        p03 + dt * p23,
        p11 + 2 * dt * p13 + d2 * p33 + q_pp,
        p12 + dt * p23,
        p13 + dt * p33 + q_pv,
        p22 + q_vv,
        p23,
        p33 + q_vv,
    )


def kf_scalar(s, p, h, z, r):
    """One measured number: z = h s, with the variance r."""
    h0, h1, h2, h3 = h
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
    b0 = p00 * h0 + p01 * h1 + p02 * h2 + p03 * h3
    b1 = p01 * h0 + p11 * h1 + p12 * h2 + p13 * h3
    b2 = p02 * h0 + p12 * h1 + p22 * h2 + p23 * h3
    b3 = p03 * h0 + p13 * h1 + p23 * h2 + p33 * h3
    w = 1.0 / (h0 * b0 + h1 * b1 + h2 * b2 + h3 * b3 + r)
    e = (z - h0 * s[0] - h1 * s[1] - h2 * s[2] - h3 * s[3]) * w
    s = (s[0] + b0 * e, s[1] + b1 * e, s[2] + b2 * e, s[3] + b3 * e)
    return s, (
        p00 - b0 * b0 * w,
        p01 - b0 * b1 * w,
        p02 - b0 * b2 * w,
        p03 - b0 * b3 * w,
        p11 - b1 * b1 * w,
        p12 - b1 * b2 * w,
        p13 - b1 * b3 * w,
        p22 - b2 * b2 * w,
        p23 - b2 * b3 * w,
        p33 - b3 * b3 * w,
    )


def kf_radar(s, p, scan):
    """Along and across the ray that is predicted, in which the three numbers are independent."""
    x, y, yaw = scan.sensor_pose
    r, az, rr = scan.measurement
    R = scan.noise_covariance
    px, py = s[0] - x, s[1] - y
    d = hypot(px, py)
    if d < 0.5:  # no ray
        return s, p
    c, e = px / d, py / d
    ux, uy = s[2] - scan.sensor_velocity[0], s[3] - scan.sensor_velocity[1]
    t = (e * ux - c * uy) / d
    gx, gy = e * t, -c * t  # of the range rate, by the place
    pred = c * ux + e * uy
    off = yaw + az - _atan2(py, px)
    off -= 2 * pi * round(off / (2 * pi))
    flat = c * px + e * py
    z_rate = rr - pred + gx * s[0] + gy * s[1] + c * s[2] + e * s[3]
    z_r = r - flat + c * s[0] + e * s[1]
    z_a = d * off + c * s[1] - e * s[0]
    s, p = kf_scalar(s, p, (c, e, 0.0, 0.0), z_r, R[0, 0])
    s, p = kf_scalar(s, p, (-e, c, 0.0, 0.0), z_a, d * d * R[1, 1])
    return kf_scalar(s, p, (gx, gy, c, e), z_rate, R[2, 2])


def _atan2(y, x):
    return float(np.arctan2(y, x))


def kf_lidar(s, p, scan):
    x, y, yaw = scan.sensor_pose
    a, b = scan.measurement
    c, e = cos(yaw), sin(yaw)
    R = scan.noise_covariance
    s, p = kf_scalar(s, p, (c, e, 0.0, 0.0), a + c * x + e * y, R[0, 0])
    return kf_scalar(s, p, (-e, c, 0.0, 0.0), b - e * x + c * y, R[1, 1])


def kf_init(scan):
    x, y, yaw = scan.sensor_pose
    a, b = scan.measurement[:2]
    R = scan.noise_covariance
    if scan.kind == "radar":
        c, e, va, vb, a, b = cos(yaw + b), sin(yaw + b), R[0, 0], a * a * R[1, 1], a, 0.0
    else:
        c, e, va, vb = cos(yaw), sin(yaw), R[0, 0], R[1, 1]
    s = (x + c * a - e * b, y + e * a + c * b, 0.0, 0.0)
    xx, xy, yy = c * c * va + e * e * vb, c * e * (va - vb), e * e * va + c * c * vb
    return s, (xx, xy, 0.0, 0.0, yy, 0.0, 0.0, 400.0, 0.0, 400.0)


class Tracker:
    def step(self, state, scan):
        if state is None:
            s, p = kf_init(scan)
        else:
            t, s, p = state
            s, p = kf_predict(s, p, scan.time - t)
            if scan.valid:
                s, p = (kf_radar if scan.kind == "radar" else kf_lidar)(s, p, scan)
        p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
        P = np.array([[p00, p01, p02, p03], [p01, p11, p12, p13], [p02, p12, p22, p23], [p03, p13, p23, p33]])
        return (scan.time, s, p), (np.array(s), P)
