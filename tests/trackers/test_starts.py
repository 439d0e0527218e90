"""Tracks that start from their first measurement, also those whose state has a yaw."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.support.scenes import scan, tracker

import trackbench as tb
from trackbench.models.sensors import SENSOR_MODELS

MODELS: dict[str, dict[str, Any]] = {
    "cv": {"motion": "cv", "acceleration_sigma_mps2": 2},
    "ca": {"motion": "ca", "jerk_sigma_mps3": 5},
    "ctrv": {"motion": "ctrv", "acceleration_sigma_mps2": 1, "yaw_acceleration_sigma_radps2": 0.3},
    "ctra": {"motion": "ctra", "jerk_sigma_mps3": 2, "yaw_acceleration_sigma_radps2": 0.3},
}
#: The truth starts with no yaw rate and no acceleration, and so the tracks are told. With a yaw the acceleration also
#: drives them while the course is unknown.
RATES = {
    "cv": {},
    "ca": {"acceleration_sigma_mps2": 0.05},
    "ctrv": {"yaw_rate_sigma_radps": 0.01},
    "ctra": {"acceleration_sigma_mps2": 1, "yaw_rate_sigma_radps": 0.01},
}
LIDAR = {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15}
RADAR = {
    "type": "radar",
    "rate_hz": 10,
    "range_sigma_m": 0.3,
    "azimuth_sigma_deg": 0.5,
    "range_rate_sigma_mps": 0.1,
}
SENSORS = {
    "lidar": (10, {"lidar": LIDAR}),
    "radar": (20, {"radar": {**RADAR, "rate_hz": 20}}),
    "lidar first": (20, {"lidar": LIDAR, "radar": {**RADAR, "phase_s": 0.05}}),
    "radar first": (20, {"lidar": {**LIDAR, "phase_s": 0.05}, "radar": RADAR}),
}


def own_model(model: str, sensors: str, filters: dict[str, Any], runs: int = 100) -> tb.Result:
    rate, seen = SENSORS[sensors]
    pieces = [{"white": MODELS[model]}]
    objects = {
        "ahead": {"start": {"x": 60, "speed_mps": 10, "course_deg": 90}, "pieces": pieces},
        "left": {"start": {"x": -20, "y": 60, "speed_mps": 10}, "pieces": pieces},
        "far": {"start": {"x": 80, "y": 40, "speed_mps": 20, "course_deg": 200}, "pieces": pieces},
    }
    start = {"velocity_sigma_mps": 10, **RATES[model]}
    return tb.run(
        tb.load(
            {
                "name": "own",
                "description": "Objects of the trackers' own model",
                "truth": {"source": "scripted", "duration_s": 1.5, "rate_hz": rate, "objects": objects},
                "sensors": seen,
                "trackers": {name: {**keys, **MODELS[model], "initial": start} for name, keys in filters.items()},
                "monte_carlo": {"runs": runs, "seed": 3},
                "score": {"settle_s": 0},
            }
        )
    )


@pytest.mark.slow
@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("model", MODELS)
def test_nees_is_right_from_the_second_estimate_on(model: str, sensors: str) -> None:
    found = own_model(model, sensors, {"ukf": {"filter": "ukf"}, "ckf": {"filter": "ckf"}}, 150).to_pandas("steps")
    for name, steps in found.groupby("tracker"):
        steps = steps[steps["count"] == 450]
        nees = steps["nees_mean"].to_numpy()[1:]
        assert len(nees) > 7
        # 20 %, and two standard errors of the mean of 450 chi-square variables with 4 degrees of freedom.
        assert np.all(np.abs(nees - 4.0) < 0.8 + 2 * np.sqrt(8 / 450)), (name, nees)


def test_the_first_measurement_and_a_wide_prior_are_the_least_squares_of_a_linear_problem() -> None:
    """Positions of a straight line, against weighted least squares with the prior of the velocity."""
    random = np.random.default_rng(0)
    times = 0.1 * np.arange(5)
    positions = np.array([30.0, 20.0]) + times[:, None] * np.array([12.0, -5.0]) + 0.3 * random.normal(size=(5, 2))
    made = tracker(filter="kf", motion="cv", acceleration_sigma_mps2=1e-6, initial={"velocity_sigma_mps": 7})
    state = None
    for time, position in zip(times, positions, strict=True):
        state, estimate = made.step(state, scan("lidar", time, position[:, None], noise=np.eye(2) * 0.09))
    for i in range(2):
        slope = np.stack([np.ones(5), times - times[-1]], axis=1) / 0.3
        information = slope.T @ slope + np.diag([0.0, 1.0 / 7**2])
        expected = np.linalg.solve(information, slope.T @ positions[:, i] / 0.3)
        np.testing.assert_allclose(estimate.mean[[i, 2 + i], 0], expected, rtol=1e-6)
        own = estimate.covariance[np.ix_([i, 2 + i], [i, 2 + i])][..., 0]
        np.testing.assert_allclose(own, np.linalg.inv(information), rtol=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_exact_measurements_give_the_exact_state(model: str) -> None:
    made = tracker(filter="ekf", **MODELS[model], initial="first_measurement")
    small = np.eye(2) * 1e-8
    state = None
    for k in range(8):
        position = np.array([[30.0 + 1.2 * k], [20.0 - 0.5 * k]])
        state, estimate = made.step(state, scan("lidar", 0.1 * k, position, noise=small))
    np.testing.assert_allclose(estimate.mean[:, 0], [38.4, 16.5, 12, -5], atol=1e-3)


def test_each_object_has_its_own_start_and_a_batch_of_runs_is_as_one_run() -> None:
    random = np.random.default_rng(1)
    valid = random.random((14, 6)) < 0.7
    where = np.array([[30.0], [20.0]]) + random.normal(size=(2, 6))
    seen = [where + np.array([[1.2], [-0.5]]) * k + 0.1 * random.normal(size=(2, 6)) for k in range(14)]
    made = tracker(filter="ukf", **MODELS["ctrv"])
    state, alone, started = None, [None] * 6, 0
    for k in range(14):
        state, together = made.step(state, scan("lidar", 0.1 * k, seen[k], valid=valid[k]))
        for i in range(6):
            alone[i], one = made.step(
                alone[i], scan("lidar", 0.1 * k, seen[k][:, i : i + 1], valid=valid[k][i : i + 1])
            )
            np.testing.assert_allclose(one.mean[:, 0], together.mean[:, i], rtol=1e-9, atol=1e-9)
        started = max(started, int(np.isfinite(together.mean[0]).sum()))
    assert started == 6


def test_a_track_that_lost_its_course_goes_on_with_position_and_velocity() -> None:
    """Out of view for four seconds, with a yaw acceleration that leaves nothing of the course."""
    keys = {"filter": "ckf", "motion": "ctrv", "acceleration_sigma_mps2": 3, "yaw_acceleration_sigma_radps2": 3}
    made, state = tracker(**keys), None
    for k in range(80):
        away = 20 <= k < 60
        position = np.array([[10.0 + 1.2 * k], [20.0]])
        state, estimate = made.step(state, scan("lidar", 0.1 * k, position, valid=not away))
        if k == 59:
            assert estimate.covariance[3, 3, 0] > 5.0**2
        if k >= 60:
            np.testing.assert_allclose(estimate.mean[:2], position, atol=0.05)
            assert np.isfinite(estimate.innovation).all()
    np.testing.assert_allclose(estimate.mean[:, 0], [104.8, 20, 12, 0], atol=0.1)


def test_an_object_that_stands_has_no_course_and_a_sound_velocity() -> None:
    random = np.random.default_rng(3)
    made, state, nees = tracker(filter="ukf", **MODELS["ctrv"]), None, []
    for k in range(40):
        seen = np.array([[40.0], [10.0]]) + 0.3 * random.normal(size=(2, 400))
        state, estimate = made.step(state, scan("lidar", 0.1 * k, seen, noise=np.eye(2) * 0.09))
        if np.isfinite(estimate.mean).all():
            error = estimate.mean - np.array([40.0, 10.0, 0.0, 0.0])[:, None]
            nees.append(np.einsum("in,nij,jn->n", error, np.linalg.inv(estimate.covariance.T), error).mean())
    # It does not accelerate as the model has it.
    assert len(nees) > 30
    assert max(nees) < 4.0


def test_range_rates_leave_two_velocities_across_the_line_of_sight() -> None:
    """Before a radar that velocity is known up to its sign, until the azimuths tell it; the covariance says so."""
    random = np.random.default_rng(4)
    noise = np.diag([0.3, np.deg2rad(1.0), 0.1]) ** 2
    made, state = tracker(filter="ukf", motion="cv", acceleration_sigma_mps2=0.5), None
    for k in range(20):
        truth = np.array([80.0, 2.0 * k, 0.0, 20.0])[:, None]
        seen = SENSOR_MODELS["radar"].measure(truth, np.zeros(3), np.zeros(2))
        seen = seen + np.sqrt(np.diag(noise))[:, None] * random.normal(size=(3, 300))
        state, estimate = made.step(state, scan("radar", 0.1 * k, seen, noise=noise))
        error = estimate.mean - truth
        information = np.linalg.inv(np.moveaxis(estimate.covariance, -1, 0))
        nees = np.einsum("in,nij,jn->n", error, information, error).mean()
        # The mean of 300 chi-square variables of 4 degrees of freedom, and a quarter more for what is not Gaussian.
        assert nees < 5.0 + 2 * np.sqrt(8 / 300), (k, nees)


@pytest.mark.parametrize("model", ["ctrv", "ctra"])
def test_a_yaw_is_not_taken_from_a_velocity_that_may_be_its_reverse(model: str) -> None:
    """Vehicles that cross before a radar: no track sets out in the wrong direction and keeps to it."""
    random = np.random.default_rng(5)
    noise = np.diag([0.3, np.deg2rad(0.5), 0.1]) ** 2
    made, state = tracker(filter="ukf", **MODELS[model]), None
    for k in range(30):
        truth = np.array([60.0, 0.5 * k, 0.0, 10.0])[:, None]
        seen = SENSOR_MODELS["radar"].measure(truth, np.zeros(3), np.zeros(2))
        seen = seen + np.sqrt(np.diag(noise))[:, None] * random.normal(size=(3, 300))
        state, estimate = made.step(state, scan("radar", 0.05 * k, seen, noise=noise))
    error = estimate.mean - truth
    nees = np.einsum("in,nij,jn->n", error, np.linalg.inv(np.moveaxis(estimate.covariance, -1, 0)), error)
    assert nees.mean() < 5.0
    assert nees.max() < 40.0
