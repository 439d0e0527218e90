"""Interacting multiple models: textbook filters and FilterPy's, sound and with the faults that people make."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter

from trackbench.base.types import Array, Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.checks.modes import modes
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.inside.pinned import models_alone
from trackbench.subjects.doctor.probes import Probes
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest


def linear(scan: Scan) -> tuple[Array, Array]:
    """The measured position and its covariance."""
    found = SENSOR_MODELS[scan.kind].position(scan)
    return found.mean, found.covariance


def motion(dt: float, sigma: float) -> tuple[Array, Array]:
    G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return np.eye(4) + dt * np.eye(4, k=2), sigma**2 * G @ G.T


class Textbook:
    """Two or three constant velocities; the state is a tuple of stacked arrays, the model first."""

    sigmas: ClassVar[tuple[float, ...]] = (0.5, 5.0)
    PI: ClassVar[Any] = np.array([[0.95, 0.05], [0.2, 0.8]])

    def step(self, state: Any, scan: Scan) -> tuple[Any, tuple[Array, Array]]:
        z, R = linear(scan)
        if state is None:
            count = len(self.sigmas)
            P = np.diag([0.0, 0.0, 100.0, 100.0])
            P[:2, :2] = R
            x = np.stack([np.append(z, [0.0, 0.0])] * count)
            state = (scan.time, x, np.stack([P] * count), np.full(count, 1 / count))
            return state, (x[0], P)
        time, x, P, mu = state
        x, P, mu = self.mix(x, P, mu)
        density = np.ones(len(mu))
        x, P = x.copy(), P.copy()
        for j, sigma in enumerate(self.sigmas):
            F, Q = motion(scan.time - time, sigma)
            x[j], P[j] = F @ x[j], F @ P[j] @ F.T + Q
            if scan.valid:
                y, S = z - x[j, :2], P[j, :2, :2] + R
                K = P[j, :, :2] @ np.linalg.inv(S)
                x[j] = x[j] + K @ y
                P[j] = P[j] - K @ S @ K.T
                P[j] = (P[j] + P[j].T) / 2
                density[j] = self.density(y, S)
        mu = self.weighed(mu, density)
        return (scan.time, x, P, mu), self.combined(x, P, mu)

    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        joint = np.asarray(self.PI) * mu[:, None]
        c = joint.sum(axis=0)
        return *mixtures(x, P, joint / c), c

    def density(self, y: Array, S: Array) -> float:
        return float(np.exp(-0.5 * y @ np.linalg.solve(S, y)) / np.sqrt(np.linalg.det(S)))

    def weighed(self, mu: Array, density: Array) -> Array:
        return mu * density / (mu @ density)

    def combined(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array]:
        return mixture(x, P, mu)


def mixture(x: Array, P: Array, weights: Array) -> tuple[Array, Array]:
    mean = weights @ x
    return mean, sum(w * (own + np.outer(one - mean, one - mean)) for w, one, own in zip(weights, x, P, strict=True))


def mixtures(x: Array, P: Array, weights: Array) -> tuple[Array, Array]:
    """A mixture for each column of the weights."""
    both = [mixture(x, P, w) for w in weights.T]
    return np.stack([mean for mean, _ in both]), np.stack([covariance for _, covariance in both])


class ThreeInLists(Textbook):
    """Transition probabilities in a list of lists."""

    sigmas = (0.3, 2.0, 8.0)
    PI: ClassVar[Any] = [[0.9, 0.07, 0.03], [0.1, 0.8, 0.1], [0.05, 0.15, 0.8]]


class OfTime(Textbook):
    """Keeps the probabilities of a second, and makes those of each step of them."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, tuple[Array, Array]]:
        self.part = 0.0 if state is None else min(scan.time - state[0], 1.0)
        return super().step(state, scan)

    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        switch = np.eye(2) + self.part * (np.asarray(self.PI) - np.eye(2))
        joint = switch * mu[:, None]
        return *mixtures(x, P, joint / joint.sum(axis=0)), joint.sum(axis=0)


class Named:
    """Two models in attributes of their own, with states of four and six entries, and probabilities as numbers."""

    stay_calm, stay_lively = 0.95, 0.85

    def __init__(self) -> None:
        self.time: float | None = None
        self.x_calm, self.P_calm = np.zeros(4), np.eye(4)
        self.x_lively, self.P_lively = np.zeros(6), np.eye(6)
        self.calm = self.lively = 0.5
        self.PI = np.array([[self.stay_calm, 1 - self.stay_calm], [1 - self.stay_lively, self.stay_lively]])

    def step(self, _state: Any, scan: Scan) -> tuple[None, tuple[Array, Array]]:
        z, R = linear(scan)
        if self.time is None:
            self.x_calm[:2] = self.x_lively[:2] = z
            self.P_calm, self.P_lively = np.diag([1.0, 1.0, 100.0, 100.0]), np.diag([1.0, 1.0, 100.0, 100.0, 4.0, 4.0])
        else:
            self.mix_and_predict(scan.time - self.time)
            if scan.valid:
                self.update(z, R)
        self.time = scan.time
        x = np.stack([self.x_calm, self.x_lively[:4]])
        return None, mixture(x, np.stack([self.P_calm, self.P_lively[:4, :4]]), np.array([self.calm, self.lively]))

    def mix_and_predict(self, dt: float) -> None:
        joint = self.PI * np.array([[self.calm], [self.lively]])
        self.calm, self.lively = joint.sum(axis=0)
        x = np.stack([np.append(self.x_calm, [0.0, 0.0]), self.x_lively])
        P = np.zeros((2, 6, 6))
        P[0, :4, :4], P[1] = self.P_calm, self.P_lively
        P[0, 4:, 4:] = np.eye(2)
        (x_calm, P_calm), (x_lively, P_lively) = (mixture(x, P, w) for w in (joint / joint.sum(axis=0)).T)
        F, Q = motion(dt, 1.0)
        self.x_calm, self.P_calm = F @ x_calm[:4], F @ P_calm[:4, :4] @ F.T + Q
        F = np.eye(6) + dt * np.eye(6, k=2) + dt**2 / 2 * np.eye(6, k=4)
        G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2), np.eye(2)])
        self.x_lively, self.P_lively = F @ x_lively, F @ P_lively @ F.T + dt * 4.0 * G @ G.T

    def update(self, z: Array, R: Array) -> None:
        density = []
        for name in ("calm", "lively"):
            x, P = getattr(self, f"x_{name}"), getattr(self, f"P_{name}")
            y, S = z - x[:2], P[:2, :2] + R
            K = P[:, :2] @ np.linalg.inv(S)
            setattr(self, f"x_{name}", x + K @ y)
            setattr(self, f"P_{name}", P - K @ S @ K.T)
            density.append(float(np.exp(-0.5 * y @ np.linalg.solve(S, y)) / np.sqrt(np.linalg.det(S))))
        self.calm, self.lively = self.calm * density[0], self.lively * density[1]
        total = self.calm + self.lively
        self.calm, self.lively = self.calm / total, self.lively / total


class SecondOrder(Textbook):
    """Generalised pseudo-Bayesian of second order: every pair of models is predicted, and then merged."""

    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        joint = np.asarray(self.PI) * mu[:, None]
        # A constant velocity is linear: merged before the prediction or after it is the same.
        return *mixtures(x, P, joint / joint.sum(axis=0)), joint.sum(axis=0)


class OfAnotherNoise(Textbook):
    """Reckons with 0.04 times the variance that is stated, also in the likelihoods."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, tuple[Array, Array]]:
        return super().step(state, scan._replace(noise_covariance=0.04 * scan.noise_covariance))


class FilterPyImm:
    """Labbe's; of positions, with 0.1 s for every step but that of the scan."""

    def __init__(self) -> None:
        self.imm: Any = None
        self.time = 0.0

    def step(self, _state: Any, scan: Scan) -> tuple[None, tuple[Array, Array]]:
        z, R = linear(scan)
        if self.imm is None:
            filters = [KalmanFilter(dim_x=4, dim_z=2) for _ in range(2)]
            for one in filters:
                one.x, one.P, one.H = np.append(z, [0.0, 0.0]), np.diag([1.0, 1.0, 100.0, 100.0]), np.eye(2, 4)
            self.imm = IMMEstimator(filters, (0.6, 0.4), np.array([[0.95, 0.05], [0.2, 0.8]]))
        else:
            for one, sigma in zip(self.imm.filters, (0.5, 5.0), strict=True):
                one.F, one.Q = motion(scan.time - self.time, sigma)
                one.R = R
            self.imm.predict()
            if scan.valid:
                self.imm.update(z)
        self.time = scan.time
        return None, (self.imm.x.copy(), self.imm.P.copy())


class Transposed(Textbook):
    PI: ClassVar[Any] = Textbook.PI

    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        joint = np.asarray(self.PI).T * mu[:, None]
        c = joint.sum(axis=0)
        return *mixtures(x, P, joint / c), c / c.sum()


class NotMixed(Textbook):
    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        return x, P, mu @ np.asarray(self.PI)


class WithoutSpread(Textbook):
    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        joint = np.asarray(self.PI) * mu[:, None]
        c = joint.sum(axis=0)
        return (joint / c).T @ x, np.einsum("ij,iab->jab", joint / c, P), c


class FirstAlreadyMixed(Textbook):
    """The second model is mixed with what the first has become."""

    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        joint = np.asarray(self.PI) * mu[:, None]
        c = joint.sum(axis=0)
        x, P = x.copy(), P.copy()
        for j, w in enumerate((joint / c).T):
            x[j], P[j] = mixture(x, P, w)
        return x, P, c


class TwoOfThree(ThreeInLists):
    """The weights of the third model are 0: it starts from the origin, of which a radar gives no direction."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, tuple[Array, Array]]:
        if state is not None and scan.kind == "radar" and not state[1].any(axis=1).all():
            raise ZeroDivisionError
        return super().step(state, scan)

    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        joint = np.asarray(self.PI) * mu[:, None]
        weights = joint / joint.sum(axis=0)
        weights[:, 2] = 0.0
        return *mixtures(x, P, weights), joint.sum(axis=0)

    def density(self, y: Array, S: Array) -> float:
        return super().density(y, S) + 1e-300


class VarianceForScale(Textbook):
    """The components of the measurement are taken one after the other."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, tuple[Array, Array]]:
        c, s = np.cos(scan.sensor_pose[2]), np.sin(scan.sensor_pose[2])
        self.into_sensor = np.array([[c, s], [-s, c]])
        return super().step(state, scan)

    def density(self, y: Array, S: Array) -> float:
        root = np.linalg.cholesky(self.into_sensor @ S @ self.into_sensor.T)
        deviations = np.linalg.solve(root, self.into_sensor @ y) * np.diag(root)
        variances = np.diag(root) ** 2
        return float(np.prod(np.exp(-0.5 * (deviations / variances) ** 2) / variances)) + 1e-300


class Inverted(Textbook):
    def weighed(self, mu: Array, density: Array) -> Array:
        return (mu / density) / (mu / density).sum()


class WithoutDeterminant(Textbook):
    def density(self, y: Array, S: Array) -> float:
        return float(np.exp(-0.5 * y @ np.linalg.solve(S, y)))


class WithoutPrior(Textbook):
    def weighed(self, mu: Array, density: Array) -> Array:
        return density / density.sum() if np.ptp(density) else mu


class NotNormalised(Textbook):
    def weighed(self, mu: Array, density: Array) -> Array:
        return 1.3 * mu * density / (mu @ density) if np.ptp(density) else mu


class SpreadNotReturned(Textbook):
    def combined(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array]:
        return mu @ x, np.einsum("j,jab->ab", mu, P)


@cache
def under_test(make: Callable[[], Any]) -> TrackerUnderTest:
    return TrackerUnderTest(make, Doctor(SENSORS).sensors, [], Probes(), 0)


@pytest.mark.parametrize("make", [Textbook, ThreeInLists, OfTime, Named, SecondOrder, OfAnotherNoise, FilterPyImm])
def test_of_a_sound_one_nothing_is_found(make: Callable[[], Any]) -> None:
    result = modes(under_test(make))
    assert [check.passed for check in result.checks] == [True, True, True]


@pytest.mark.parametrize(
    ("make", "fault", "words"),
    [
        (Transposed, "imm_transition_transposed", "joint"),
        (NotMixed, "imm_mixing_wrong", "from its own estimate"),
        (WithoutSpread, "imm_mixing_wrong", "spread of the means is left out"),
        (FirstAlreadyMixed, "imm_mixing_wrong", ""),
        (TwoOfThree, "imm_mixing_wrong", "means are not those"),
        (VarianceForScale, "imm_likelihood_wrong", "taken for its root"),
        (Inverted, "imm_likelihood_wrong", "do not follow"),
        (WithoutDeterminant, "imm_likelihood_wrong", "determinant"),
        (WithoutPrior, "imm_likelihood_wrong", "left out"),
        (NotNormalised, "imm_likelihood_wrong", "add up to 1.3"),
        (SpreadNotReturned, "imm_combination_wrong", "spread of the models' means is left out"),
    ],
)
def test_a_fault_is_named(make: Callable[[], Any], fault: str, words: str) -> None:
    first, *_ = modes(under_test(make)).findings
    assert first.fault == fault
    assert words in first.evidence


def test_a_filter_without_models_is_asked_nothing() -> None:
    class Single(Textbook):
        sigmas = (2.0,)
        PI: ClassVar[Any] = np.ones((1, 1))

    assert modes(under_test(Single)).checks == []


@pytest.mark.parametrize("make", [Textbook, ThreeInLists, FilterPyImm])
def test_a_model_alone_is_its_filter(make: type) -> None:
    """Its answers are those of the filter of that model."""
    tracker = under_test(make)
    models = models_alone(tracker)
    assert len(models) == len(getattr(make, "sigmas", (0, 0)))
    scan = tracker.probes.general[0].scan("lidar", tracker.sensors["lidar"], 1.0)
    for model, sigma in zip(models, getattr(make, "sigmas", (0.5, 5.0)), strict=True):
        with model.alone() as alone:
            trial = alone.trial(alone.probes.general[0], "lidar", ("lidar",))
            assert trial is not None
            now = trial.prediction
            later = trial.session.predict(scan)
            assert later is not None
            F, _ = motion(1.0, sigma)
            growth = later.covariance - F @ now.covariance @ F.T
            # The estimate is predicted over 0.05 s, and then over 1.05 s in place of that.
            grown = growth[2, 2] / sigma**2
            assert grown == pytest.approx(1.05**2 - 0.05**2, rel=0.2)
