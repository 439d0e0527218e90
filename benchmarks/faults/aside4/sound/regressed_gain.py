"""The gain is a regression on logarithms, learned before; the covariance is that of the gain that it gives."""

import numpy as np
from benchmarks.faults.parts import Filter, moved, position, with_gain

# Of the logit of alpha: constant, and by q = log(predicted deviation of the place / noise), its square,
# and by log(predicted deviation of the speed * 0.1 s / that of the place).
ALPHA = np.array([0.02, 1.86, 0.05, 0.02])
SHARE = 0.9  # of what the place adds, that the velocity is given


class Tracker(Filter):
    def predicted(self, x, P, dt):
        return moved(x, P, dt, 4.0)

    def corrected(self, x, P, scan):
        z, R = position(scan)
        values, axes = np.linalg.eigh(R)  # the gain is along the axes of the noise
        K = np.zeros((4, 2))
        for noise, axis in zip(np.sqrt(np.maximum(values, 1e-6)), axes.T, strict=True):
            place = np.sqrt(axis @ P[:2, :2] @ axis)
            speed = np.sqrt(axis @ P[2:, 2:] @ axis)
            q = np.clip(np.log(place / noise), -4.0, 4.0)
            features = np.array([1.0, q, q * q, np.clip(np.log(speed * 0.1 / place), -4.0, 4.0)])
            alpha = 1 / (1 + np.exp(-ALPHA @ features))
            share = np.clip(axis @ P[2:, :2] @ axis / place**2, 0.0, 30.0)  # m/s per m
            K[:2] += alpha * np.outer(axis, axis)
            K[2:] += SHARE * alpha * share * np.outer(axis, axis)
        return with_gain(x, P, K, z - x[:2], np.eye(2, 4), R)
