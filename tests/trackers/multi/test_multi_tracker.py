"""Trackers of several objects: what each says of scans that do not say whose detection is whose."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scenes import NOISE
from tests.support.traffic_scans import FALSE_ALARM, Traffic, traffic, vehicles

from trackbench.base.types import Array, Tracks, scan_of_run
from trackbench.testing import check_tracker
from trackbench.trackers.associate import EXISTENCE
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import MultiObjectTracker, build_multi

METHODS = ("gnn", "jpda", "jipda", "pmb", "oracle", "naive")
FILTERS: dict[str, dict[str, Any]] = {
    "kf-cv": {"filter": "kf", "motion": "cv"},
    "ekf-cv": {"filter": "ekf", "motion": "cv"},
    "ekf-ca": {"filter": "ekf", "motion": "ca"},
    "ukf-ctrv": {"filter": "ukf", "motion": "ctrv"},
    "ukf-additive": {"filter": "ukf", "motion": "ctrv", "augmented": False},
    "ckf-ctra": {"filter": "ckf", "motion": "ctra"},
}


def config(method: str, filter_name: str = "ekf-cv", **associate: object) -> FilterConfig:
    keys = FILTERS[filter_name]
    return FilterConfig.model_validate({**keys, **NOISE[keys["motion"]], "associate": {"method": method, **associate}})


def tracker(method: str, filter_name: str = "ekf-cv", **associate: object) -> MultiObjectTracker:
    return build_multi(config(method, filter_name, **associate)).tracker


def alone(origins: Array) -> Array:
    """Origins of detections of which none is merged."""
    return np.stack([origins, np.full_like(origins, -1)])


def followed(of: MultiObjectTracker, seen: Traffic, run: int | None = None) -> list[Tracks]:
    """The tracks after each scan, of all runs or of one without padding."""
    state, said = None, []
    for scan, origins in zip(seen.scans, seen.origins, strict=True):
        one = scan if run is None else scan_of_run(scan, run)
        own = origins if run is None else origins[: one.valid.size, run]
        state, tracks = of.step(state, one, *((alone(own),) if of.wants_origins else ()))
        said.append(tracks)
    return said


@pytest.mark.parametrize("filter_name", FILTERS)
def test_without_doubt_the_states_are_those_of_the_labelled_run(filter_name: str) -> None:
    count = 5
    seen = traffic(vehicles(count, spacing=40.0), 20, detection=1.0, clutter=0.0)
    # Tracks of several objects start in the state of their motion model.
    labelled = replace(build(config("gnn", filter_name)).tracker, cartesian_fallback="never")
    state, estimates = None, []
    for scan, origins in zip(seen.scans, seen.origins, strict=True):
        order = np.argsort(origins[:, 0])
        known = scan._replace(measurement=scan.measurement[:, order, 0], valid=scan.valid[order, 0])
        state, estimate = labelled.step(state, known)
        estimates.append(estimate)
    for method in ("gnn", "oracle", "naive"):
        said = followed(tracker(method, filter_name, confirm=[1, 1]), seen, run=0)
        for origins, tracks, estimate in zip(seen.origins, said, estimates, strict=True):
            assert tracks.ids.tolist() == list(range(count))
            assert tracks.used is not None
            # Whose track has which id is settled by the first scan.
            owner = origins[tracks.used, 0]
            assert sorted(owner) == list(range(count))
            # The one corrects a covariance by its square root, the other by a difference: each rounds it up on its own.
            apart = estimate.covariance[..., owner]
            sigma = np.sqrt(np.einsum("ii...->i...", apart))
            assert np.all(np.abs(tracks.mean - estimate.mean[:, owner]) < 1e-11 * (1.0 + sigma))
            assert np.all(np.abs(tracks.covariance - apart) < 1e-11 * (1.0 + sigma[:, None] * sigma))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("filter_name", ["ekf-cv", "ukf-ctrv", "kf-cv"])
def test_a_batch_of_runs_equals_each_run_alone(method: str, filter_name: str) -> None:
    runs = 3
    seen = traffic(vehicles(8, spacing=7.0), 16, runs, detection=0.85, clutter=6.0, seed=3)
    whole = followed(tracker(method, filter_name), seen)
    kept = 0
    for run in range(runs):
        for scan, together, alone in zip(
            seen.scans, whole, followed(tracker(method, filter_name), seen, run), strict=True
        ):
            own = together.ids[:, run] >= 0
            np.testing.assert_array_equal(together.ids[own, run], alone.ids)
            assert together.used is not None
            assert alone.used is not None
            np.testing.assert_array_equal(together.used[own, run], alone.used)
            np.testing.assert_allclose(together.mean[:, own, run], alone.mean, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(together.covariance[..., own, run], alone.covariance, rtol=1e-12, atol=1e-12)
            assert np.isnan(together.mean[:, ~own, run]).all()
            assert (together.existence is None) == (method not in ("jipda", "pmb"))
            if together.existence is not None:
                np.testing.assert_allclose(together.existence[own, run], alone.existence, rtol=1e-12)
            kept += own.sum()
            assert scan.valid.shape[1] == runs
    assert kept > 300


@pytest.mark.parametrize("method", METHODS)
def test_the_order_of_a_scan_changes_nothing_but_which_column_was_used(method: str) -> None:
    seen = traffic(vehicles(8, spacing=6.0), 25, detection=0.85, clutter=8.0, seed=7)
    random = np.random.default_rng(1)
    orders = [random.permutation(scan.valid.shape[0]) for scan in seen.scans]
    shuffled = Traffic(
        [
            s._replace(measurement=s.measurement[:, o], valid=s.valid[o])
            for s, o in zip(seen.scans, orders, strict=True)
        ],
        [origins[o] for origins, o in zip(seen.origins, orders, strict=True)],
        seen.truth,
    )
    same = []
    for order, a, b in zip(
        orders, followed(tracker(method), seen, 0), followed(tracker(method), shuffled, 0), strict=True
    ):
        assert a.used is not None
        assert b.used is not None
        if method == "naive":
            same.append(np.array_equal(a.mean, b.mean))
            continue
        np.testing.assert_array_equal(a.ids, b.ids)
        np.testing.assert_array_equal(a.mean, b.mean)
        np.testing.assert_array_equal(a.covariance, b.covariance)
        np.testing.assert_array_equal(a.used >= 0, b.used >= 0)
        np.testing.assert_array_equal(a.used[a.used >= 0], order[b.used[b.used >= 0]])
    # The naive tracker believes in the order.
    assert method != "naive" or not all(same)


@settings(max_examples=15, deadline=None)
@given(
    method=st.sampled_from(METHODS),
    detection=st.sampled_from([0.3, 0.6, 0.9]),
    clutter=st.sampled_from([0.0, 3.0, 20.0]),
    delete=st.sampled_from([0.06, 0.3]),
    seed=st.integers(0, 1000),
)
def test_ids_count_up_from_0_and_none_comes_again(
    method: str, detection: float, clutter: float, delete: float, seed: int
) -> None:
    seen = traffic(vehicles(6, spacing=6.0), 25, runs=2, detection=detection, clutter=clutter, seed=seed)
    highest, alive = [-1, -1], [set(), set()]
    for tracks in followed(tracker(method, delete_after_s=delete), seen):
        for run in range(2):
            ids = tracks.ids[tracks.ids[:, run] >= 0, run].tolist()
            assert len(ids) == len(set(ids))
            new = sorted(track for track in ids if track > highest[run])
            assert new == list(range(highest[run] + 1, highest[run] + 1 + len(new)))
            # A track whose existence has become probable again is reported again.
            assert method in EXISTENCE or set(ids) - alive[run] == set(new)
            highest[run], alive[run] = highest[run] + len(new), set(ids)


@pytest.mark.parametrize("method", METHODS)
def test_an_empty_scan_predicts(method: str) -> None:
    seen = traffic(vehicles(4, spacing=30.0), 20, detection=1.0, clutter=0.0)
    of = tracker(method)
    state = None
    for scan, origins in zip(seen.scans, seen.origins, strict=True):
        state, before = of.step(state, scan_of_run(scan, 0), *((alone(origins[:, 0]),) if of.wants_origins else ()))
    last = scan_of_run(seen.scans[-1], 0)
    empty = last._replace(time=last.time + 0.2, measurement=last.measurement[:, :0], valid=last.valid[:0])
    _, after = of.step(state, empty, *((alone(np.zeros(0, dtype=int)),) if of.wants_origins else ()))
    assert len(before.ids) == 4
    np.testing.assert_array_equal(after.ids, before.ids)
    np.testing.assert_array_equal(after.used, -1)
    np.testing.assert_allclose(after.mean[:2], before.mean[:2] + 0.2 * before.mean[2:], atol=1e-9)
    assert (np.einsum("iik->ik", after.covariance) > np.einsum("iik->ik", before.covariance)).all()


def test_the_oracle_takes_every_detection_of_its_object_and_no_false_alarm() -> None:
    seen = traffic(vehicles(8, spacing=3.0), 30, detection=0.8, clutter=20.0)
    owner: dict[int, int] = {}
    for tracks, origins in zip(followed(tracker("oracle"), seen, 0), seen.origins, strict=True):
        assert tracks.used is not None
        for number, column in zip(tracks.ids, tracks.used, strict=True):
            if column >= 0:
                assert origins[column, 0] == owner.setdefault(int(number), int(origins[column, 0]))
    assert sorted(owner.values()) == list(range(8))
    assert FALSE_ALARM not in owner.values()


def test_the_oracle_gives_a_merged_detection_to_both_objects() -> None:
    seen = traffic(vehicles(2, spacing=3.0), 12, detection=1.0, clutter=0.0, sensors=("lidar",))
    of, state = tracker("oracle"), None
    for k, (scan, origins) in enumerate(zip(seen.scans, seen.origins, strict=True)):
        one, both = scan_of_run(scan, 0), alone(origins[: scan.valid.shape[0], 0])
        if k > 5:
            kept = both[0] == 0
            merged = one.measurement[:, kept] + [[0.0], [1.5]]
            one = one._replace(measurement=merged, valid=np.array([True]), time=scan.time)
            both = np.array([[0], [1]])
        state, tracks = of.step(state, one, both)
        assert tracks.ids.tolist() == [0, 1]
        if k > 5:
            assert tracks.used is not None
            assert tracks.used.tolist() == [0, 0]


def test_the_covariance_has_the_spread_of_the_innovations() -> None:
    """Bar-Shalom, Daum and Huang (2009), "The probabilistic data association filter", equations 38 to 43."""
    seen = traffic(vehicles(1), 12, detection=1.0, clutter=0.0, sensors=("lidar",))
    of = tracker("jpda", confirm=[1, 1])
    state = None
    for scan in seen.scans:
        state, tracks = of.step(state, scan_of_run(scan, 0))
    last = scan_of_run(seen.scans[-1], 0)
    x, p = tracks.mean[:, 0], tracks.covariance[..., 0]
    dt = 0.05
    f = np.eye(4) + dt * np.eye(4, k=2)
    g = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
    x, p = f @ x, f @ p @ f.T + g @ g.T * 4.0
    z = x[:2, None] + np.array([[0.2, -0.3, 0.1], [0.1, 0.2, -0.4]])
    density, detection, gate = 0.5, 0.9, 0.9999
    now = last._replace(
        time=last.time + dt, measurement=z, valid=np.ones(3, dtype=bool),
        detection_probability=detection, clutter_density=density,
    )  # fmt: skip
    _, after = of.step(state, now)
    s = p[:2, :2] + last.noise_covariance
    gain = p[:, :2] @ np.linalg.inv(s)
    innovation = z - x[:2, None]
    likelihood = np.exp(-0.5 * np.einsum("ik,ij,jk->k", innovation, np.linalg.inv(s), innovation))
    likelihood /= 2 * np.pi * np.sqrt(np.linalg.det(s))
    share = np.append(detection * likelihood / density, 1 - detection * gate)
    share /= share.sum()
    mean = innovation @ share[:3]
    spread = (innovation * share[:3]) @ innovation.T - np.outer(mean, mean)
    corrected = p - gain @ s @ gain.T
    np.testing.assert_allclose(after.mean[:, 0], x + gain @ mean, rtol=0, atol=1e-12)
    expected = share[3] * p + (1 - share[3]) * corrected + gain @ spread @ gain.T
    np.testing.assert_allclose(after.covariance[..., 0], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", [method for method in METHODS if method != "oracle"])
def test_the_rules_for_trackers_of_several_objects_hold(method: str) -> None:
    assert len(check_tracker(lambda: tracker(method), identities="hidden")) > 6


def test_a_sensor_that_is_not_read_changes_nothing() -> None:
    seen = traffic(vehicles(5, spacing=20.0), 20, runs=2)
    keys = {**FILTERS["ekf-cv"], **NOISE["cv"], "sensors": ["radar"], "associate": {"method": "gnn"}}
    of = build_multi(FilterConfig.model_validate(keys)).tracker
    only = Traffic(*(values[::2] for values in seen))
    for a, b in zip(followed(of, seen)[::2], followed(of, only), strict=True):
        np.testing.assert_array_equal(a.mean, b.mean)
    asked = followed(of, seen)[-1]
    assert asked.used is not None
    assert (asked.ids >= 0).sum() >= 10
    assert (asked.used == -1).all()
