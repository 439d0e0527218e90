"""What built-in trackers make of scans that are older than their state."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from pydantic import ValidationError
from tests.scenes import NOISE, TRACKERS, scan, tracker
from tests.traffic_scans import traffic, vehicles

import trackbench as tb
from trackbench.filters import KalmanFilter
from trackbench.models.motion import MotionModel
from trackbench.multi import build_multi
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.initial_config import InitialConfig
from trackbench.types import Array, Estimate, Scan

FIRST = {"from": "first_reading", "velocity_sigma_mps": 10}


class WhiteAcceleration(MotionModel):
    """Constant velocity, driven by continuous white noise: two steps are the same as one of their length."""

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")
    linear: ClassVar[bool] = True
    driving_noise: ClassVar[tuple[str, ...]] = ("a", "b", "c", "d")
    a: float = 1.0
    b: float = 1.0
    c: float = 1.0
    d: float = 1.0

    def transition(self, x: Array, dt: float) -> Array:
        return np.concatenate([x[:2] + dt * x[2:], x[2:]])

    def jacobian(self, x: Array, dt: float) -> Array:
        return np.kron([[1, dt], [0, 1.0]], np.eye(2))

    def noise_gain(self, x: Array, dt: float) -> Array:
        if dt == 0.0:
            return np.zeros((4, 4))
        return np.kron(np.linalg.cholesky([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))


def linear(late: str, lag: float = 1.0) -> FilterTracker:
    initial = InitialConfig.model_validate(FIRST)
    return FilterTracker(KalmanFilter(WhiteAcceleration()), initial, late=late, lag_s=lag)


def lidar_scans(count: int = 12, seed: int = 0, batch: int = 3, period: float = 0.1) -> list[Scan]:
    random = np.random.default_rng(seed)
    valid = random.random((count, batch)) < 0.9
    valid[0] = True
    made = []
    for k in range(count):
        position = np.array([[40.0], [30.0]]) + period * k * np.array([[12.0], [-5.0]])
        made.append(scan("lidar", period * k, position + 0.3 * random.normal(size=(2, batch)), valid=valid[k]))
    return made


def mixed_scans() -> list[Scan]:
    """A radar and a lidar in turns."""
    random = np.random.default_rng(2)
    made = []
    for k in range(16):
        at = np.array([60.0, 20.0]) + 0.05 * k * np.array([-9.0, 4.0])
        if k % 2:
            distance = np.hypot(*at)
            ideal = [distance, np.arctan2(at[1], at[0]), at @ [-9.0, 4.0] / distance]
            noise = random.normal(size=(3, 2)) * np.array([[0.3], [0.01], [0.2]])
            made.append(scan("radar", 0.05 * k, np.array(ideal)[:, None] + noise))
        else:
            made.append(scan("lidar", 0.05 * k, at[:, None] + 0.15 * random.normal(size=(2, 2))))
    return made


def taken(of: Any, scans: list[Scan]) -> list[Estimate]:
    state, said = None, []
    for one in scans:
        state, estimate = of.step(state, one)
        said.append(estimate)
    return said


def swapped(scans: list[Scan], *numbers: int) -> list[Scan]:
    """The scans of these numbers each after the one that follows it."""
    order = list(range(len(scans)))
    for number in numbers:
        order[number], order[number + 1] = order[number + 1], order[number]
    return [scans[k] for k in order]


IMM = {
    "filter": "ukf",
    "motion": {"imm": [{"model": "cv", **NOISE["cv"]}, {"model": "ctrv", **NOISE["ctrv"]}], "stay_s": [5, 2]},
}


@pytest.mark.parametrize("keys", [*TRACKERS.values(), IMM], ids=[*TRACKERS, "imm"])
@pytest.mark.parametrize("initial", ["first_reading", "batch"])
def test_replayed_scans_are_as_good_as_in_order(keys: dict[str, Any], initial: str) -> None:
    scans = mixed_scans()
    late = [scans[k] for k in (0, 2, 1, 3, 6, 5, 4, 8, 10, 9, 7, 11, 12, 14, 13, 15)]
    made = tracker(**keys, initial=initial)
    one, other = taken(made, scans)[-1], taken(made, late)[-1]
    np.testing.assert_allclose(other.mean, one.mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-12, atol=1e-12)
    assert np.isfinite(one.mean).all()


def test_a_late_scan_shows_the_innovation_of_its_own_time() -> None:
    scans = lidar_scans()
    prompt, late = taken(linear("replay"), scans), taken(linear("replay"), swapped(scans, 4))
    np.testing.assert_allclose(late[5].innovation, prompt[4].innovation, rtol=1e-12)
    np.testing.assert_allclose(late[5].mean, prompt[5].mean, rtol=1e-12)


def test_retrodiction_over_one_step_is_exact_for_a_linear_problem() -> None:
    """Algorithm A1, with process noise, scans late again and again."""
    scans = lidar_scans(14, batch=1)
    scans = [one._replace(valid=np.array([True]), measurement=np.nan_to_num(one.measurement, nan=42)) for one in scans]
    for late in ([5], [3, 6, 9], [2, 11]):
        one, other = taken(linear("replay"), scans), taken(linear("retrodiction"), swapped(scans, *late))
        for number in late:
            np.testing.assert_allclose(other[number + 1].mean, one[number + 1].mean, rtol=1e-10)
            np.testing.assert_allclose(other[number + 1].covariance, one[number + 1].covariance, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(other[-1].mean, one[-1].mean, rtol=1e-10)


def test_retrodiction_over_several_steps_is_nearly_exact() -> None:
    """Algorithm Al1: the measurements since count as one, with noise that is taken to be independent."""
    scans = lidar_scans(14, batch=1)
    scans = [one._replace(valid=np.array([True]), measurement=np.nan_to_num(one.measurement, nan=42)) for one in scans]
    late = [*scans[:4], *scans[5:9], scans[4]]
    exact, found, dropped = (taken(linear(method), late)[-1] for method in ("replay", "retrodiction", "drop"))
    np.testing.assert_allclose(found.covariance[..., 0], exact.covariance[..., 0], rtol=0.02, atol=1e-12)
    far, near = (np.abs(one.mean - exact.mean).max() for one in (dropped, found))
    assert near < 0.5 * far


def test_both_are_the_least_squares_of_all_measurements() -> None:
    """Brute force: the states at all instants as unknowns of one linear problem."""
    scans = lidar_scans(6, batch=1)
    scans = [one._replace(valid=np.array([True]), measurement=np.nan_to_num(one.measurement, nan=42)) for one in scans]
    model, count = WhiteAcceleration(), len(scans)
    rows, right = [], []

    def add(number: int, slope: Array, value: Array, covariance: Array, before: Array | None = None) -> None:
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        row = np.zeros((len(value), 4 * count))
        row[:, 4 * number : 4 * number + 4] = slope
        if before is not None:
            row[:, 4 * number - 4 : 4 * number] = before
        rows.append(root @ row)
        right.append(root @ value)

    add(0, np.eye(4)[2:], np.zeros(2), 100 * np.eye(2))
    for k, one in enumerate(scans):
        add(k, np.eye(4)[:2], one.measurement[:, 0], one.noise_covariance)
        if k:
            gain = model.noise_gain(np.zeros(4), 0.1)
            add(k, np.eye(4), np.zeros(4), gain @ gain.T, -model.jacobian(np.zeros(4), 0.1))
    a, b = np.concatenate(rows), np.concatenate(right)
    expected = np.linalg.solve(a.T @ a, a.T @ b)[-4:]
    covariance = np.linalg.inv(a.T @ a)[-4:, -4:]
    for late in ("replay", "retrodiction"):
        found = taken(linear(late), swapped(scans, 2, 4))[-1]
        np.testing.assert_allclose(found.mean[:, 0], expected, rtol=1e-9)
        np.testing.assert_allclose(found.covariance[..., 0], covariance, rtol=1e-7)


def test_what_is_dropped_changes_nothing() -> None:
    scans = lidar_scans()
    without, late = scans[:4] + scans[5:], swapped(scans, 4)
    np.testing.assert_array_equal(taken(linear("drop"), late)[-1].mean, taken(linear("drop"), without)[-1].mean)
    # What is older than the lag is dropped too.
    short, late = linear("replay", lag=0.05), [*scans[:4], *scans[5:7], scans[4], *scans[7:]]
    np.testing.assert_array_equal(taken(short, late)[-1].mean, taken(short, without)[-1].mean)


def test_as_new_lags_by_the_way_that_the_object_goes_in_the_latency() -> None:
    """Exact measurements of an object of constant velocity, all late by the same time."""
    velocity, latency = np.array([[12.0], [-5.0]]), 0.3
    scans = [
        scan("lidar", 0.1 * k, 0.1 * k * velocity, noise=1e-6 * np.eye(2))._replace(arrival_time=0.1 * k + latency)
        for k in range(30)
    ]
    for late, bias in (("as_new", -latency * velocity), ("replay", 0 * velocity)):
        made, state = tracker(filter="kf", motion="cv", late=late, **NOISE["cv"]), None
        for one in scans:
            state, _ = made.step(state, one)
            _, estimate = made.step(state, one._replace(time=one.arrival_time, valid=np.array([False]), asked=True))
        np.testing.assert_allclose(estimate.mean[:2] - scans[-1].arrival_time * velocity, bias, atol=1e-6)
        np.testing.assert_allclose(estimate.mean[2:], velocity, atol=1e-6)


@pytest.mark.parametrize("advance", ["own_scans", "all_scans"])
def test_what_is_answered_is_not_kept(advance: str) -> None:
    scans = lidar_scans()
    made = tracker(filter="ukf", motion="ctrv", advance_at=advance, **NOISE["ctrv"])
    state, asked_state = None, None
    asked_state, _ = made.step(asked_state, scans[0]._replace(time=-0.5, valid=scans[0].valid & False, asked=True))
    for one in scans:
        state, plain = made.step(state, one)
        ask = one._replace(time=one.time + 0.05, valid=one.valid & False, asked=True)
        asked_state, asked = made.step(asked_state, one)
        asked_state, _ = made.step(asked_state, ask)
        np.testing.assert_array_equal(asked.mean, plain.mean)


@pytest.mark.parametrize("method", ["gnn", "jpda", "pmb"])
def test_replay_of_several_objects_is_as_in_order(method: str) -> None:
    made = traffic(vehicles(4), 12, runs=2)
    config = {"filter": "ekf", "motion": "cv", **NOISE["cv"], "associate": {"method": method}}
    scans = made.scans
    late = [scans[k] for k in (0, 1, 3, 2, *range(4, 16), 17, 18, 16, *range(19, 24))]
    of = build_multi(FilterConfig.model_validate(config))
    one, other = taken(of, scans)[-1], taken(of, late)[-1]
    np.testing.assert_array_equal(other.ids, one.ids)
    np.testing.assert_allclose(other.mean, one.mean, rtol=1e-12)
    dropping = build_multi(FilterConfig.model_validate({**config, "late": "drop"}))
    without = [one for k, one in enumerate(late) if k not in (3, 18)]
    np.testing.assert_array_equal(taken(dropping, late)[-1].mean, taken(dropping, without)[-1].mean)


def test_tracks_say_what_they_took_of_a_late_scan() -> None:
    made = traffic(vehicles(3), 12, detection=1.0, clutter=0.0)
    of = build_multi(
        FilterConfig.model_validate({"filter": "ekf", "motion": "cv", **NOISE["cv"], "associate": {"method": "gnn"}})
    )
    scans = [*made.scans[:16], *made.scans[17:19], made.scans[16]]
    said = taken(of, scans)[-1]
    origins = made.origins[16][:, 0]
    assert sorted(origins[said.used[:, 0]]) == [0, 1, 2]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({**IMM, "late": "retrodiction"}, "retrodiction does not go with several motion models"),
        (
            {"filter": "ekf", "motion": "cv", **NOISE["cv"], "associate": {"method": "gnn"}, "late": "retrodiction"},
            "retrodiction does not go with associate",
        ),
        ({"filter": "ekf", "motion": "cv", **NOISE["cv"], "late": "drop", "lag_s": 2}, "not used with late: drop"),
    ],
)
def test_what_does_not_go_together_is_said(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        FilterConfig.model_validate(keys)


def test_replay_and_retrodiction_are_consistent_and_as_new_is_not() -> None:
    """On truth of the filters' own model, whose noise is constant over the steps that they predict."""
    own = {"motion": "cv", "acceleration_sigma_mps2": 2}
    start = {"from": "truth", "velocity_sigma_mps": 5}
    scenario = {
        "name": "late",
        "description": "A late lidar between prompt ones",
        "truth": {
            "source": "scripted",
            "duration_s": 4,
            "rate_hz": 10,
            "objects": {"car": {"start": {"x": 60, "speed_mps": 15, "course_deg": 90}, "pieces": [{"white": own}]}},
        },
        "sensors": {
            "prompt": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.3},
            "late": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15, "latency_s": 0.1},
        },
        "trackers": {
            late: {"filter": "ekf", "late": late, "initial": start, **own}
            for late in ("as_new", "replay", "retrodiction")
        },
        "monte_carlo": {"runs": 400, "seed": 3},
        "score": {"settle_s": 1},
    }
    found = {one.name: one for one in tb.run(tb.load(scenario)).summary.trackers}
    assert found["replay"].nees.mean == pytest.approx(4.0, abs=0.3)
    assert found["retrodiction"].nees.mean == pytest.approx(4.0, abs=0.3)
    assert found["as_new"].nees.mean > 20
    rmse = {name: one.metrics["position_rmse"].value for name, one in found.items()}
    # One step of a linear problem, for which both are exact.
    assert rmse["retrodiction"] == pytest.approx(rmse["replay"], rel=1e-9)
    assert rmse["as_new"] > 3 * rmse["replay"]
