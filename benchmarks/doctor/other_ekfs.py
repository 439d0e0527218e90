"""Sound relatives of the extended Kalman filter, plain NumPy."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .plain import Array, Belief, symmetric, wrap
from .plain_ekf import PlainEkf


class BiasEkf(PlainEkf):
    """A constant error of the radar's range (component 0, m) or azimuth (component 1, rad) as a fifth state."""

    def __init__(self, component: int = 0, bias_sigma: float = 0.5, **options: Any) -> None:
        super().__init__(**options)
        self.component, self.bias_sigma = component, bias_sigma

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        own = np.zeros((5, 5))
        own[:4, :4], own[4, 4] = P, self.bias_sigma**2
        return np.append(x, 0.0), own

    def output(self, x: Array, P: Array) -> Belief:
        return x[:4], P[:4, :4]

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        F, Q = np.eye(5), np.zeros((5, 5))
        F[:4, :4], Q[:4, :4] = self.transition_jacobian(dt), self.process_noise(x, dt)
        Q[4, 4] = (0.01 * self.bias_sigma) ** 2 * dt
        return F @ x, symmetric(F @ P @ F.T) + Q

    def predicted_measurement(self, target: Array, scan: Any) -> Array:
        z = super().predicted_measurement(target[:4], scan)
        if scan.kind == "radar":
            z[self.component] += target[4]
            z[1] = wrap(z[1])
        return z

    def sensor_jacobian(self, x: Array, scan: Any) -> Array:
        H = super().sensor_jacobian(x[:4], scan)
        own = np.hstack([H, np.zeros((len(H), 1))])
        if scan.kind == "radar":
            own[self.component, 4] = 1.0
        return own


class AdaptiveEkf(PlainEkf):
    """Process noise by the size of the last innovations: a NIS above its expectation raises it (Bar-Shalom, Li and
    Kirubarajan 2001, section 11.2.2). Keeps its tuning in the instance."""

    step_up, least, most = 1.3, 1.0, 9.0

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        y = self.innovation(scan, self.predicted_measurement(x, scan))
        H = self.sensor_jacobian(x, scan)
        S = H @ P @ H.T + self.noise(scan)
        nis = y @ np.linalg.solve(S, y) / len(y)
        factor = self.step_up if nis > 2.0 else 1 / self.step_up**0.2
        self.acceleration_sigma = float(np.clip(factor * self.acceleration_sigma, self.least, self.most))
        return self.corrected(x, P, np.linalg.solve(S, H @ P).T, y, S)


class InformationFilter(PlainEkf):
    """Keeps ``P^-1 x`` and ``P^-1``."""

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        Y = np.linalg.inv(P)
        return Y @ x, Y

    def output(self, x: Array, P: Array) -> Belief:
        covariance = symmetric(np.linalg.inv(P))
        return covariance @ x, covariance

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        return self.from_cartesian(*super().predict(*self.output(x, P), dt))

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        mean = self.output(x, P)[0]
        H = self.sensor_jacobian(mean, scan)
        weighted = H.T @ np.linalg.inv(self.noise(scan))
        y = self.innovation(scan, self.predicted_measurement(mean, scan))
        return x + weighted @ (y + H @ mean), symmetric(P + weighted @ H)


class Modes(NamedTuple):
    """The two filters of an IMM between scans."""

    time: float
    beliefs: tuple[Belief, Belief]
    weights: Array


class PlainImm(PlainEkf):
    """A calm and a lively constant velocity, interacting (Blom and Bar-Shalom 1988)."""

    sigmas = (1.0, 6.0)
    leave_per_s = 0.2

    def step(self, state: Any, scan: Any) -> tuple[Any, Belief | None]:
        if not isinstance(state, Modes):
            track, answer = super().step(state, scan)
            if answer is None:
                return track, None
            return Modes(track.time, (answer, answer), np.array([0.5, 0.5])), answer
        dt = scan.time - state.time
        stay = 0.5 + 0.5 * np.exp(-2 * self.leave_per_s * dt)
        switch = np.array([[stay, 1 - stay], [1 - stay, stay]])
        weights = switch.T @ state.weights
        beliefs, likelihoods = [], np.ones(2)
        for mode in range(2):
            x, P = mixture(switch[:, mode] * state.weights / weights[mode], state.beliefs)
            self.acceleration_sigma = self.sigmas[mode]
            x, P = self.predict(x, P, dt)
            if self.usable(scan):
                y = self.innovation(scan, self.predicted_measurement(x, scan))
                H = self.sensor_jacobian(x, scan)
                S = H @ P @ H.T + self.noise(scan)
                likelihoods[mode] = np.exp(-0.5 * y @ np.linalg.solve(S, y)) / np.sqrt(np.linalg.det(S)) + 1e-300
                x, P = self.corrected(x, P, np.linalg.solve(S, H @ P).T, y, S)
            beliefs.append((x, P))
        weights = weights * likelihoods / (weights @ likelihoods)
        modes = Modes(scan.time, (beliefs[0], beliefs[1]), weights)
        return modes, mixture(weights, modes.beliefs)


def mixture(weights: Array, beliefs: tuple[Belief, Belief]) -> Belief:
    """Mean and covariance of a weighted sum of Gaussians."""
    mean = weights @ np.array([x for x, _ in beliefs])
    apart = [(x - mean, P) for x, P in beliefs]
    return mean, symmetric(sum(w * (P + np.outer(d, d)) for w, (d, P) in zip(weights, apart, strict=True)))
