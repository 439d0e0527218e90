"""Errors, times and motions at the ends of what a scenario may state: right by exact arithmetic, and alike by both
engines."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.engine.agreement import FILTERS
from tests.support.places import SCENARIOS
from tests.support.scenes import scan, tracker

from trackbench.base import linalg
from trackbench.base.errors import TrackbenchError
from trackbench.base.types import Array, Scan
from trackbench.engine.choice import Engine
from trackbench.filters import Belief, ExtendedKalmanFilter, KalmanFilter, SigmaPointFilter
from trackbench.filters.kalman import CUBATURE, SymmetricSet
from trackbench.models.motion import ConstantVelocity
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.scenario import load_scenario
from trackbench.trackers.filtered import SmoothedTracker

BATCH = 4
POSE, OWN = (1.0, -2.0, 0.3), (5.0, 1.0)
Sensors = list[tuple[str, Array]]


def lidar(sigma: float) -> tuple[str, Array]:
    return "lidar", np.diag(np.square([sigma, sigma]))


def radar(range_m: float, azimuth_deg: float, rate_mps: float) -> tuple[str, Array]:
    return "radar", np.diag(np.square([range_m, np.deg2rad(azimuth_deg), rate_mps]))


#: All corners of the ranges of the sensors' errors, and accurate sensors beside inaccurate ones.
CORNERS: list[Sensors] = [
    *([lidar(sigma)] for sigma in (1e-6, 1e-3, 1.0, 1e4)),
    *([radar(*sigmas)] for sigmas in product((1e-6, 1.0, 1e4), (1e-7, 0.1, 60.0), (1e-6, 1.0, 1e4))),
    [lidar(1e-6), lidar(1e4)],
    [lidar(1e4), lidar(1e-6)],
    *([lidar(a), radar(b, c, d)] for a, b, c, d in product((1e-6, 1e4), (1e-6, 1e4), (1e-7, 60.0), (1e-6, 1e4))),
]


def drive(sensors: Sensors, times: Array, speed: float = 15.0, start: Any = (30.0, 5.0), seed: int = 0) -> list[Scan]:
    """Scans of targets that drive straight on in all directions; some are missed."""
    random = np.random.default_rng(seed)
    course = random.uniform(-3.0, 3.0, BATCH)
    velocity = speed * np.array([np.cos(course), np.sin(course)])
    scans = []
    for k, time in enumerate(times):
        kind, noise = sensors[k % len(sensors)]
        target = np.concatenate([np.reshape(start, (2, 1)) + velocity * time, velocity])
        exact = SENSOR_MODELS[kind].measure(target, np.array(POSE), np.array(OWN))
        measured = exact + np.sqrt(np.diag(noise))[:, None] * random.normal(size=exact.shape)
        valid = (random.random(BATCH) < 0.9) | (k == 0)
        scans.append(scan(kind, float(time), measured, valid, noise, POSE, OWN))
    return scans


def require_sound(name: str, scans: list[Scan], initial: Any = "first_measurement", engine: Engine = "numpy") -> Array:
    """All estimates are finite, and their covariances definite; with one motion model none was repaired."""
    made = replace(tracker(**FILTERS[name], initial=initial), engine=engine)
    state = None
    for seen in scans:
        state, estimate = made.step(state, seen)
        assert np.isfinite(estimate.mean).all()
        assert linalg.cholesky(estimate.covariance).positive.all()
        assert name.endswith("imm") or estimate.repaired is None or not estimate.repaired.any()
    return estimate.mean


QUICK = ("kf-cv", "ekf-cv", "ukf-cv")
MORE = (
    *("kf-ca", "ekf-ca", "ekf-ctrv", "ekf-ctra", "ukf-ctrv", "ukf_additive-ctra", "ckf-ca", "ckf-ctra"),
    *("kf-imm", "ekf-imm", "ukf-imm", "ckf-imm"),
)
CASES = [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in MORE)]


@pytest.mark.parametrize("name", CASES)
def test_every_corner_of_the_errors_by_both_engines(name: str) -> None:
    for sensors in CORNERS:
        scans = drive(sensors, 0.1 * np.arange(12))
        for engine in ("numpy", "fused"):
            require_sound(name, scans, engine=engine)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kf-cv", "ekf-cv", "ekf-ctrv", "ukf-ctrv", "ckf-ca", "ekf-imm"])
def test_every_corner_smoothed(name: str) -> None:
    for sensors, engine in product(CORNERS, ("numpy", "fused")):
        made = replace(tracker(**FILTERS[name]), engine=engine)
        for estimate in SmoothedTracker(made).estimates(drive(sensors, 0.1 * np.arange(12))):
            assert np.isfinite(estimate.mean).all()
            assert linalg.cholesky(estimate.covariance).positive.all()


Exact = list[list[Fraction]]


def exactly(values: Array) -> Exact:
    return [[Fraction(float(value)) for value in row] for row in np.atleast_2d(values)]


def times(a: Exact, b: Exact) -> Exact:
    columns = list(zip(*b, strict=True))
    return [[sum((x * y for x, y in zip(row, column, strict=True)), Fraction()) for column in columns] for row in a]


def plus(a: Exact, b: Exact, sign: int = 1) -> Exact:
    return [[x + sign * y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def exact_update(mean: Exact, p: Exact, y: Exact, r: Exact) -> tuple[Exact, Exact]:
    """The Kalman filter's update by a position, in rational numbers: there is no rounding."""
    (a, b), (c, d) = plus([row[:2] for row in p[:2]], r)
    determinant = a * d - b * c
    inverse = [[d / determinant, -b / determinant], [-c / determinant, a / determinant]]
    gain = times([row[:2] for row in p], inverse)
    return plus(mean, times(gain, plus(y, mean[:2], -1))), plus(p, times(gain, p[:2]), -1)


LINEAR = {
    "kf": KalmanFilter,
    "ekf": ExtendedKalmanFilter,
    "ukf": lambda motion: SigmaPointFilter(motion, SymmetricSet(1.0, 0.0, 1.0)),
    "ukf, additive": lambda motion: SigmaPointFilter(motion, SymmetricSet(1.0, 0.0, 1.0), augmented=False),
    "ckf": lambda motion: SigmaPointFilter(motion, CUBATURE),
}


@pytest.mark.parametrize("predicted", [False, True], ids=["by its square root", "with its prediction"])
@pytest.mark.parametrize("kind", LINEAR)
@pytest.mark.parametrize("sigmas", [(1e-6, 1e-6), (1e4, 1e-6), (1e-6, 1e4), (1e4, 1e4), (1.0, 1e-6)])
@pytest.mark.parametrize("first", [1e-6, 1.0, 1e4, 1e7], ids="P0 {}".format)
def test_updates_are_right_by_exact_arithmetic(
    kind: str, sigmas: tuple[float, float], first: float, predicted: bool
) -> None:
    own = LINEAR[kind](ConstantVelocity(acceleration_sigma_mps2=1e-3))
    belief = Belief(np.array([[30.0], [5.0], [10.0], [3.0]]), np.diag(np.square([first, first, 20.0, 20.0]))[..., None])
    for k in range(4):
        measurement, noise = np.array([[31.0 + 1.25 * k], [5.25 + 0.375 * k]]), np.diag(np.square([sigmas[k % 2]] * 2))
        before, seen = own.predict(belief, 0.125), scan("lidar", 0.125 * k, measurement, noise=noise)
        # As trackers of several objects do, which weigh the measurements by their prediction.
        expected = own.predict_measurement(before, seen) if predicted else None
        belief = own.update(before, seen, expected).belief
        prior = before.covariance[..., 0]
        mean, p = exact_update(exactly(before.mean), exactly(prior), exactly(measurement), exactly(noise))
        exact = np.array([[float(x) for x in row] for row in p])
        sigma = np.sqrt(np.diag(exact))
        apart = (belief.covariance[..., 0] - exact) / np.outer(sigma, sigma)
        # A velocity that follows from the position is as good as the covariance before, whose entries are rounded.
        rounding = 1e-9 + 4.0 * linalg.MARGIN * np.diag(prior) / sigma**2
        assert np.all(np.abs(apart) <= np.sqrt(np.outer(rounding, rounding)))
        if not predicted:
            ratio = np.finfo(float).eps * np.sqrt(prior[0, 0]) / sigma[0]
            assert np.abs(apart[:2, :2]).max() < 1e-9 + 8.0 * ratio**2
        away = np.array([float(Fraction(float(x)) - y[0]) for x, y in zip(belief.mean[:, 0], mean, strict=True)])
        # Sigma points are the mean and their deviations in one number.
        x, change = np.abs(belief.mean[:, 0]), np.abs(belief.mean - before.mean)[:, 0]
        assert np.all(np.abs(away) <= 1e-6 * sigma + 1e-12 * x + 1e-8 * change + 1e-15 * np.sqrt(np.diag(prior)))


any_sigma = st.floats(-6.0, 4.0).map(lambda power: 10.0**power)
any_angle = st.floats(-7.0, 1.7).map(lambda power: 10.0**power)
any_sensor = st.one_of(st.builds(lidar, any_sigma), st.builds(radar, any_sigma, any_angle, any_sigma))
bounded = settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


@pytest.mark.parametrize("name", ["kf-cv", "ekf-ctrv", "ukf-ctrv", pytest.param("ekf-imm", marks=pytest.mark.slow)])
@given(
    sensors=st.lists(any_sensor, min_size=1, max_size=3),
    steps=st.lists(st.sampled_from([0.0, 1e-6, 1e-3, 0.1, 10.0, 1e4]), min_size=8, max_size=12),
    speed=st.sampled_from([0.0, 15.0, 1e4]),
    start=st.sampled_from([(30.0, 5.0), POSE[:2], (1e4, 1e4)]),
    velocity_sigma=st.sampled_from([1e-9, 20.0, 1e4, 1e9]),
    seed=st.integers(0, 2**32 - 1),
)
@bounded
def test_any_errors_times_and_motion(
    name: str,
    sensors: Sensors,
    steps: list[float],
    speed: float,
    start: tuple[float, float],
    velocity_sigma: float,
    seed: int,
) -> None:
    initial = {"from": "first_measurement", "velocity_sigma_mps": velocity_sigma}
    require_sound(name, drive(sensors, np.cumsum(steps), speed, start, seed), initial)


@pytest.mark.parametrize("name", ["kf-cv", "ekf-cv", "ukf-ctrv"])
def test_noise_that_is_singular_to_rounding(name: str) -> None:
    near = np.array([[1.0, 1.0 - 1e-16], [1.0 - 1e-16, 1.0]])
    for noise in (near, 1e-12 * np.ones((2, 2)), 1e8 * np.ones((2, 2))):
        require_sound(name, drive([("lidar", noise), radar(0.3, 1.0, 0.1)], 0.1 * np.arange(20)))
    require_sound(name, drive([("radar", 1e-4 * np.ones((3, 3)))], 0.1 * np.arange(20)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kf-cv", "ekf-cv", "ukf-ctrv"])
def test_a_hundred_thousand_steps(name: str) -> None:
    sensors = [radar(0.3, 0.5, 0.1), lidar(1e-6), lidar(1e4)]
    # Around the sensor, so that numbers do not grow with the time.
    few = drive(sensors, 0.1 * np.arange(300), speed=0.5)
    back = [seen._replace(time=60.0 - seen.time) for seen in reversed(few)]
    made = replace(tracker(**FILTERS[name]), engine="fused")
    state = None
    for lap in range(167):
        for seen in [*few, *back]:
            later = seen._replace(time=seen.time + 60.1 * lap, arrival_time=seen.time + 60.1 * lap)
            state, estimate = made.step(state, later)
        assert np.isfinite(estimate.mean).all()
        assert linalg.cholesky(estimate.covariance).positive.all()
        assert estimate.repaired is None or not estimate.repaired.any()


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ("lidar.position_sigma_m=1.0e-9", "must be at least 1e-06"),
        ("lidar.position_sigma_m=1.0e+5", "must be at most 10000"),
        ("radar.azimuth_sigma_deg=1.0e-8", "must be at least 1e-07"),
    ],
)
def test_errors_beyond_the_ranges_are_refused_with_the_reason(stated: str, words: str) -> None:
    with pytest.raises(TrackbenchError, match=re.escape(words)):
        load_scenario(SCENARIOS / "scripted" / "figure_eight.yaml", [f"sensors.{stated}"])
