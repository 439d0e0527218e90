"""Measurements are given less than their weight while the prediction is much less accurate than they are.

The covariance is that of the smaller gain. As on the Space Shuttle, this covers the second-order terms.
"""

import numpy as np
from benchmarks.faults.parts import difference, expected, first, moved, with_gain

SHARE = 0.2  # of the predicted part of the innovation's covariance
LIMIT = 4.0  # of the predicted variance over that of the noise, per component


def step(state, scan):
    if state is None:
        x, P = first(scan)
    else:
        time, x, P = state
        x, P = moved(x, P, scan.time - time)
        if scan.valid:
            x, P = corrected(x, P, scan)
    return (scan.time, x, P), (x, P)


def corrected(x, P, scan):
    R = scan.noise_covariance
    h, H = expected(x, scan)
    y = difference(scan.measurement, h, scan)
    own = H @ P @ H.T
    second = spread(P, x, scan)
    if np.trace(np.linalg.solve(R, own)) > LIMIT * len(y):
        own = (1 + SHARE) * own
    K = np.linalg.solve(own + R + second, H @ P).T
    x, P = with_gain(x, P, K, y, H, R + second)
    return x, (P + P.T) / 2


def spread(P, x, scan):
    """Of the bend of range and azimuth over the predicted error, as additional noise."""
    if scan.kind != "radar":
        return np.zeros((2, 2))
    d = x[:2] - scan.sensor_pose[:2]
    r = np.hypot(*d)
    ray, aside = d / r, np.array([-d[1], d[0]]) / r
    along, across = ray @ P[:2, :2] @ ray, aside @ P[:2, :2] @ aside
    turned = aside @ P[:2, :2] @ aside * (aside @ P[2:, 2:] @ aside) / r**2
    return np.diag([3 * across**2 / (4 * r**2), 3 * across * along / r**4, 3 * turned])


class Tracker:
    step = staticmethod(step)
