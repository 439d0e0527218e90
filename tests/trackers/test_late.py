"""What built-in trackers make of scans that are older than their state."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from tests.support.late_scans import WhiteAcceleration, late_tracker, lidar_scans, linear, swapped, taken
from tests.support.scenes import NOISE, TRACKERS, scan
from tests.support.traffic_scans import traffic, vehicles

from trackbench.base.types import Array, Estimate, Scan
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi
from trackbench.trackers.track_steps import log_likelihood


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


IMM = {
    "filter": "ukf",
    "motion": {"imm": [{"model": "cv", **NOISE["cv"]}, {"model": "ctrv", **NOISE["ctrv"]}], "stay_s": [5, 2]},
}


@pytest.mark.parametrize("keys", [*TRACKERS.values(), IMM], ids=[*TRACKERS, "imm"])
@pytest.mark.parametrize("initial", ["first_measurement", "two_measurements"])
def test_replayed_scans_are_as_good_as_in_order(keys: dict[str, Any], initial: str) -> None:
    scans = mixed_scans()
    late = [scans[k] for k in (0, 2, 1, 3, 6, 5, 4, 8, 10, 9, 7, 11, 12, 14, 13, 15)]
    made = late_tracker(**keys, initial=initial)
    one, other = taken(made, scans)[-1], taken(made, late)[-1]
    np.testing.assert_allclose(other.mean, one.mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-12, atol=1e-12)
    assert np.isfinite(one.mean).all()


def test_replay_takes_scans_of_one_time_in_the_order_of_the_sensors() -> None:
    """As when nothing is late, on which what a nonlinear filter says depends."""
    scans = [one._replace(time=0.1 * (k // 2), place=k % 2) for k, one in enumerate(mixed_scans())]
    made = late_tracker(filter="ekf", motion="cv", **NOISE["cv"])
    expected = taken(made, scans)[-1].mean
    for late in (swapped(scans, 4, 10), [*scans[:4], *scans[5:9], scans[4], *scans[9:]]):
        np.testing.assert_allclose(taken(made, late)[-1].mean, expected, rtol=1e-12, atol=1e-12)


def test_a_late_scan_shows_the_innovation_of_its_own_time() -> None:
    scans = lidar_scans()
    prompt, late = taken(linear("replay"), scans), taken(linear("replay"), swapped(scans, 4))
    np.testing.assert_allclose(late[5].innovation, prompt[4].innovation, rtol=1e-12)
    np.testing.assert_allclose(late[5].mean, prompt[5].mean, rtol=1e-12)


def test_a_replay_is_the_least_squares_of_all_measurements() -> None:
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
    found = taken(linear("replay"), swapped(scans, 2, 4))[-1]
    np.testing.assert_allclose(found.mean[:, 0], expected, rtol=1e-9)
    np.testing.assert_allclose(found.covariance[..., 0], covariance, rtol=1e-7)


def total_log_likelihood(said: list[Estimate], scans: list[Scan]) -> Array:
    found = [log_likelihood(estimate) for estimate in said]
    return np.sum([np.where(of.valid & ~np.isnan(one), one, 0.0) for one, of in zip(found, scans, strict=True)], axis=0)


def joint_log_density(scans: list[Scan]) -> Array:
    """Of all measurements given the first, from their joint covariance; each object seen in all scans."""
    model, count = WhiteAcceleration(), len(scans)
    z = np.stack([one.measurement for one in scans])
    mean, covariance = np.zeros((count, 2, z.shape[2])), np.zeros((count, 2, count, 2))
    p = np.diag([*np.diag(scans[0].noise_covariance), 100.0, 100.0])
    for k in range(count):
        if k:
            gain, f = model.noise_gain(np.zeros(4), 0.1), model.jacobian(np.zeros(4), 0.1)
            p = f @ p @ f.T + gain @ gain.T
        mean[k] = z[0]
        for j in range(k, count):
            covariance[j, :, k] = (model.jacobian(np.zeros(4), 0.1 * (j - k)) @ p)[:2, :2]
            covariance[k, :, j] = covariance[j, :, k].T
        covariance[k, :, k] += scans[k].noise_covariance
    s = covariance[1:, :, 1:].reshape(2 * count - 2, 2 * count - 2)
    y = (z - mean)[1:].reshape(2 * count - 2, -1)
    return -0.5 * (np.einsum("ik,ik->k", y, np.linalg.solve(s, y)) + np.linalg.slogdet(2 * np.pi * s)[1])


def test_log_likelihoods_in_the_order_of_arrival_add_up_to_the_joint_density() -> None:
    """Each of a scan given all that arrived before it, also where the scan that arrives late starts the track."""
    scans = lidar_scans(12, valid=1.0)
    joint = joint_log_density(scans)
    for order in (
        [0, 1, 2, 4, 3, 5, 7, 6, 8, 10, 9, 11],
        [0, 4, 2, 3, 1, 9, 5, 8, 7, 6, 10, 11],
        [1, 2, 0, *range(3, 12)],
        [*range(1, 12), 0],
    ):
        arrived = [scans[k] for k in order]
        np.testing.assert_allclose(total_log_likelihood(taken(linear("replay", 2), arrived), arrived), joint, atol=1e-9)


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
        made, state = late_tracker(filter="kf", motion="cv", late=late, **NOISE["cv"]), None
        for one in scans:
            state, _ = made.step(state, one)
            _, estimate = made.step(state, one._replace(time=one.arrival_time, valid=np.array([False]), asked=True))
        np.testing.assert_allclose(estimate.mean[:2] - scans[-1].arrival_time * velocity, bias, atol=1e-6)
        np.testing.assert_allclose(estimate.mean[2:], velocity, atol=1e-6)


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


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"filter": "ekf", "motion": "cv", **NOISE["cv"], "late": "drop", "lag_s": 2}, "not used with late: drop"),
    ],
)
def test_what_does_not_go_together_is_said(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        FilterConfig.model_validate(keys)
