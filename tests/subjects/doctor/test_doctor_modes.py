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
from trackbench.subjects.doctor.inside.pinned import single_models
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


class WithoutSpread(Textbook):
    def mix(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array, Array]:
        joint = np.asarray(self.PI) * mu[:, None]
        c = joint.sum(axis=0)
        return (joint / c).T @ x, np.einsum("ij,iab->jab", joint / c, P), c


class WithoutDeterminant(Textbook):
    def density(self, y: Array, S: Array) -> float:
        return float(np.exp(-0.5 * y @ np.linalg.solve(S, y)))


class NotNormalised(Textbook):
    def weighed(self, mu: Array, density: Array) -> Array:
        return 1.3 * mu * density / (mu @ density) if np.ptp(density) else mu


class SpreadNotReturned(Textbook):
    def combined(self, x: Array, P: Array, mu: Array) -> tuple[Array, Array]:
        return mu @ x, np.einsum("j,jab->ab", mu, P)


@cache
def under_test(make: Callable[[], Any]) -> TrackerUnderTest:
    return TrackerUnderTest(make, Doctor(SENSORS).sensors, [], Probes(), 0)


@pytest.mark.parametrize("make", [Textbook, ThreeInLists, FilterPyImm])
def test_of_a_sound_one_nothing_is_found(make: Callable[[], Any]) -> None:
    result = modes(under_test(make))
    assert [check.passed for check in result.checks] == [True, True, True]


@pytest.mark.parametrize(
    ("make", "fault", "words"),
    [
        (WithoutSpread, "imm_mixing_wrong", "spread of the means is left out"),
        (WithoutDeterminant, "imm_likelihood_wrong", "determinant"),
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
    models = single_models(tracker)
    assert len(models) == len(getattr(make, "sigmas", (0, 0)))
    scan = tracker.probes.general[0].scan("lidar", tracker.sensors["lidar"], 1.0)
    for model, sigma in zip(models, getattr(make, "sigmas", (0.5, 5.0)), strict=True):
        with model.as_tracker() as alone:
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
