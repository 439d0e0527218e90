"""Sound filters of samples, plain NumPy: a particle filter and two ensemble Kalman filters. Each keeps its samples in
the instance."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import MIN_RANGE, Array, Belief, PlainTracker, rotation, wrap

ACCELERATIONS = 2


class SampledTracker(PlainTracker):
    """Samples ``(4, N)`` of constant velocity with white acceleration; ``draw`` is where all chance comes from."""

    random = True
    count = 4000

    def __init__(self, start: str = "two_measurements", seed: int | None = None, **options: Any) -> None:
        super().__init__(start=start, **options)
        self.random = np.random.default_rng(seed)
        self.track: Any = None
        self.samples: Array | None = None

    def step(self, state: Any, scan: Any) -> tuple[float, Belief | None]:
        before, self.track = self.track, self.track
        self.track, answer = super().step(before, scan)
        return scan.time, answer

    def draw(self, *shape: int) -> Array:
        return self.random.standard_normal(shape)

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        self.samples = x[:, None] + np.linalg.cholesky(P) @ self.draw(4, self.count)
        return self.moments()

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        a = self.acceleration_sigma * self.draw(ACCELERATIONS, self.count)
        self.samples = np.vstack([self.samples[:2] + dt * self.samples[2:] + dt**2 / 2 * a, self.samples[2:] + dt * a])
        return self.moments()

    def moments(self) -> Belief:
        return self.samples.mean(axis=1), np.cov(self.samples)

    def seen(self, scan: Any) -> Array:
        """``(m, N)`` the measurement of each sample."""
        apart = self.samples[:2] - scan.sensor_pose[:2, None]
        x, y = rotation(scan.sensor_pose[2]).T @ apart
        if scan.kind == "lidar":
            return np.array([x, y])
        r = np.maximum(np.hypot(x, y), MIN_RANGE)
        rate = np.sum(apart * (self.samples[2:] - scan.sensor_velocity[:, None]), axis=0) / r
        return np.array([r, np.arctan2(y, x), rate])

    def differences(self, scan: Any, a: Array, b: Array) -> Array:
        d = a - b
        if scan.kind == "radar":
            d[1] = wrap(d[1])
        return d


class ParticleFilter(SampledTracker):
    """Regularised particle filter with progressive correction (Musso, Oudjane and Le Gland 2001).

    A likelihood that would leave few particles is applied in several powers. Resampled particles are moved a little,
    without a change of their mean and covariance (Liu and West 2001).
    """

    keep = 0.97
    #: Share of the particles that has to remain effective in each power.
    effective = 0.3

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        remaining = 1.0
        while remaining > 0.0:
            y = self.differences(scan, scan.measurement[:, None], self.seen(scan))
            logs = -0.5 * np.einsum("in,ij,jn->n", y, np.linalg.inv(self.noise(scan)), y)
            power = remaining
            while (weights := normalised(power * logs)) @ weights * self.effective * self.count > 1.0:
                power /= 2
            remaining -= power
            mean, P = self.resample(weights)
        return mean, P

    def resample(self, weights: Array) -> Belief:
        """The weighted moments; the particles have no weights then."""
        mean = self.samples @ weights
        apart = self.samples - mean[:, None]
        P = apart * weights @ apart.T
        places = (np.arange(self.count) + self.random.uniform()) / self.count
        chosen = self.samples[:, np.minimum(np.searchsorted(np.cumsum(weights), places), self.count - 1)]
        noise = np.linalg.cholesky(P + 1e-12 * np.eye(4)) @ self.draw(4, self.count)
        self.samples = self.keep * chosen + (1 - self.keep) * mean[:, None] + np.sqrt(1 - self.keep**2) * noise
        return mean, P


def normalised(logs: Array) -> Array:
    weights = np.exp(logs - logs.max())
    return weights / weights.sum()


class EnsembleFilter(SampledTracker):
    """Stochastic ensemble Kalman filter: each sample gets a measurement of its own (Burgers et al. 1998)."""

    count = 2000

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        R = self.noise(scan)
        seen = self.seen(scan)
        middle = seen[:, :1]
        spread = self.differences(scan, seen, middle)
        mean = spread.mean(axis=1, keepdims=True)
        perturbed = np.linalg.cholesky(R) @ self.draw(len(R), self.count)
        perturbed -= perturbed.mean(axis=1, keepdims=True)
        h, a = spread - mean, self.samples - self.samples.mean(axis=1, keepdims=True)
        K = np.linalg.solve(h @ h.T / (self.count - 1) + R, h @ a.T / (self.count - 1)).T
        y = self.differences(scan, scan.measurement[:, None] + perturbed, middle) - spread
        self.samples = self.samples + K @ (wrapped_azimuth(y) if scan.kind == "radar" else y)
        return self.moments()


class SquareRootEnsemble(EnsembleFilter):
    """Deterministic ensemble filter: the samples' spread is transformed to the right covariance (Whitaker and Hamill
    2002), and nothing is drawn after a seeded start."""

    random = False
    count = 200

    def draw(self, *shape: int) -> Array:
        drawn = np.random.default_rng(7).standard_normal(shape)
        drawn -= drawn.mean(axis=1, keepdims=True)
        return np.linalg.solve(np.linalg.cholesky(np.cov(drawn)), drawn)

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        moved = F @ P @ F.T
        self.samples = self.spread_to(F @ self.samples, moved, moved + self.acceleration_sigma**2 * G @ G.T)
        return self.moments()

    def spread_to(self, samples: Array, before: Array, after: Array) -> Array:
        mean = samples.mean(axis=1, keepdims=True)
        change = np.linalg.cholesky(after) @ np.linalg.inv(np.linalg.cholesky(before))
        return mean + change @ (samples - mean)

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        seen = self.seen(scan)
        spread = self.differences(scan, seen, seen[:, :1])
        mean = spread.mean(axis=1, keepdims=True)
        h, a = spread - mean, self.samples - x[:, None]
        S = h @ h.T / (self.count - 1) + self.noise(scan)
        K = np.linalg.solve(S, h @ a.T / (self.count - 1)).T
        y = self.differences(scan, scan.measurement, seen[:, 0]) - mean[:, 0]
        if scan.kind == "radar":
            y[1] = wrap(y[1])
        after = P - K @ S @ K.T
        self.samples = self.spread_to(self.samples, P, (after + after.T) / 2) + (K @ y)[:, None]
        return self.moments()


def wrapped_azimuth(y: Array) -> Array:
    y[1] = wrap(y[1])
    return y
