"""The Rauch-Tung-Striebel smoothers."""

import numpy as np
import pytest
from scipy import stats
from tests.support.reference import smoothed
from tests.support.scenes import LIDAR_NOISE, NOISE, scan

from trackbench.base.types import Gaussian
from trackbench.base.units import difference
from trackbench.filters import (
    CUBATURE,
    Belief,
    ExtendedKalmanFilter,
    KalmanFilter,
    SigmaPointFilter,
    SymmetricSet,
)
from trackbench.models.motion import MOTION_MODELS

MODELS = {name: cls(**NOISE[name]) for name, cls in MOTION_MODELS.loaded().items()}
KINDS = {
    "kf": KalmanFilter,
    "ekf": ExtendedKalmanFilter,
    "ukf": lambda motion: SigmaPointFilter(motion, SymmetricSet(0.7, 2.0, 1.0)),
    "classic ukf": lambda motion: SigmaPointFilter(motion, SymmetricSet(1.0, 0.0, None)),
    "additive ukf": lambda motion: SigmaPointFilter(motion, SymmetricSet(1.0, 2.0, 0.0), augmented=False),
    "ckf": lambda motion: SigmaPointFilter(motion, CUBATURE, augmented=False),
}
every_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
INTERVALS = [0.1, 0.3, 0.1, 0.2, 0.5, 0.1, 0.1, 0.4, 0.2, 0.1]


def filtered(filter, belief, measurements, intervals=INTERVALS) -> list[Belief]:
    beliefs, time = [], 0.0
    for k, measurement in enumerate(measurements):
        if k > 0:
            belief = filter.predict(belief, intervals[k - 1])
            time += intervals[k - 1]
        belief = filter.update(belief, scan("lidar", time, measurement)).belief
        beliefs.append(belief)
    return beliefs


def least_squares(motion, prior: Gaussian, measurements, intervals) -> list[Gaussian]:
    """The states that fit prior, noises and measurements best; the first state and the noises are unknown."""
    size, drivers = len(motion.components), len(motion.noise_sigma)
    unknowns = size + drivers * len(intervals)
    state = np.eye(size, unknowns)
    states = [state]
    for k, dt in enumerate(intervals):
        noise = np.zeros((drivers, unknowns))
        noise[:, size + k * drivers :][:, :drivers] = np.diag(motion.noise_sigma)
        state = motion.jacobian(prior.mean, dt) @ state + motion.noise_gain(prior.mean, dt) @ noise
        states.append(state)
    white = np.linalg.inv(np.linalg.cholesky(prior.covariance))
    seen = np.linalg.inv(np.linalg.cholesky(LIDAR_NOISE))
    rows = [np.pad(white, ((0, 0), (0, unknowns - size))), np.eye(unknowns)[size:], *(seen @ one[:2] for one in states)]
    right = [white @ prior.mean, np.zeros(unknowns - size), *(seen @ measurement for measurement in measurements)]
    triangle = np.linalg.qr(np.concatenate(rows), mode="r")
    root = np.linalg.inv(triangle)
    solution = root @ (root.T @ (np.concatenate(rows).T @ np.concatenate(right)))
    return [Gaussian(one @ solution, (one @ root) @ (one @ root).T) for one in states]


@every_kind
@pytest.mark.parametrize("name", ["cv", "ca"])
def test_on_a_linear_problem_it_is_the_least_squares_solution(kind, name):
    motion, random = MODELS[name], np.random.default_rng(2)
    size = len(motion.components)
    root = random.normal(size=(size, size))
    prior = Gaussian(np.arange(1.0, size + 1.0), root @ root.T + np.eye(size))
    measurements = [np.array([1.0 + 3.0 * k, 2.0 - 0.5 * k]) + random.normal(size=2) for k in range(11)]
    filter = kind(motion)
    beliefs = filtered(filter, Belief(*prior), measurements)
    expected = least_squares(motion, prior, measurements, INTERVALS)
    found = smoothed(filter, beliefs, INTERVALS)
    for one, solution in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.mean, solution.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(one.covariance, solution.covariance, rtol=1e-9, atol=1e-9)
    assert np.all(np.diag(found[0].covariance) < 0.95 * np.diag(beliefs[0].covariance))


def turning_runs(runs, steps=30, dt=0.2, seed=4):
    """Runs of CTRV's own motion: states, measurements and the first belief, whose course passes pi."""
    motion, random = MODELS["ctrv"], np.random.default_rng(seed)
    covariance = np.diag(np.square([0.5, 0.5, 0.5, 0.05, 0.05]))
    mean = np.repeat(np.array([[20.0], [10.0], [12.0], [3.0], [0.2]]), runs, axis=1)
    x = mean + np.sqrt(np.diag(covariance))[:, None] * random.normal(size=mean.shape)
    states, measurements = [], []
    for k in range(steps):
        if k > 0:
            noise = np.array(motion.noise_sigma)[:, None] * random.normal(size=(2, runs))
            x = motion.transition(x, dt) + np.einsum("nq...,q...->n...", motion.noise_gain(x, dt), noise)
        states.append(x)
        measurements.append(x[:2] + np.sqrt(LIDAR_NOISE[0, 0]) * random.normal(size=(2, runs)))
    belief = Belief(mean, np.repeat(covariance[..., None], runs, axis=2))
    return states, measurements, belief, [dt] * (steps - 1)


@pytest.mark.parametrize("name", ["ekf", "ukf", "additive ukf", "ckf"])
def test_of_targets_that_turn_as_the_model_says_it_is_consistent_and_better_than_the_filter(name):
    runs = 400
    states, measurements, first, intervals = turning_runs(runs)
    filter = KINDS[name](MODELS["ctrv"])
    beliefs = filtered(filter, first, measurements, intervals)
    found = smoothed(filter, beliefs, intervals)
    angular = MODELS["ctrv"].angular
    low, high = stats.chi2.ppf([0.001, 0.999], 5 * runs) / runs
    for k in (0, 10, 20, 29):
        error = difference(found[k].mean, states[k], angular)
        nees = np.mean(np.sum(error * np.linalg.solve(found[k].covariance.T, error.T[..., None])[..., 0].T, axis=0))
        assert low < nees < high, k
    for k in (5, 10, 20):
        before, after = (np.mean(difference(one[k].mean, states[k], angular) ** 2, axis=1) for one in (beliefs, found))
        assert np.all(after < 0.9 * before)


@every_kind
def test_a_batch_is_the_loop_over_its_members(kind):
    name = "cv" if kind is KalmanFilter else "ctrv"
    motion = MODELS[name]
    _, measurements, first, intervals = turning_runs(3, steps=8)
    size = len(motion.components)
    first = Belief(first.mean[:size], first.covariance[:size, :size])
    filter = kind(motion)
    together = smoothed(filter, filtered(filter, first, measurements, intervals), intervals)
    for i in range(3):
        one = Belief(first.mean[:, i], first.covariance[..., i])
        alone = smoothed(filter, filtered(filter, one, [seen[:, i] for seen in measurements], intervals), intervals)
        for a, b in zip(together, alone, strict=True):
            np.testing.assert_allclose(a.mean[:, i], b.mean, rtol=1e-10, atol=1e-10)
            np.testing.assert_allclose(a.covariance[..., i], b.covariance, rtol=1e-10, atol=1e-10)
