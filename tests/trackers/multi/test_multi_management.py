"""When tracks of several objects are confirmed and deleted, against what probability says."""

from __future__ import annotations

from itertools import product
from math import comb

import numpy as np
import pytest
from scipy.special import gammaincinv
from tests.support.traffic_scans import NOISE, PADDING, RANGE, one_scan, traffic, vehicles

from trackbench.base.types import FieldOfView, Scan, scan_of_run
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import MultiObjectTracker, build_multi

VELOCITY_SIGMA = 5.0


def tracker(method: str = "gnn", **associate: object) -> MultiObjectTracker:
    keys = {
        "filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 1.0,
        "initial": {"from": "first_measurement", "velocity_sigma_mps": VELOCITY_SIGMA},
        "associate": {"method": method, **associate},
    }  # fmt: skip
    return build_multi(FilterConfig.model_validate(keys)).tracker


def lidar(time: float, detections: np.ndarray, valid: np.ndarray, probability: float) -> Scan:
    return Scan(
        time, "lidar", "lidar", np.where(valid, detections, np.nan), valid, np.diag(NOISE["lidar"]), np.zeros(3),
        np.zeros(2), time, probability, 1e-6, FieldOfView(np.pi, RANGE),
    )  # fmt: skip


@pytest.mark.parametrize("probability", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("rule", [(2, 3), (3, 5), (4, 6)])
@pytest.mark.parametrize("method", ["gnn", "jipda"])
def test_the_probability_of_confirmation_is_the_bernoulli_sum(
    method: str, probability: float, rule: tuple[int, int]
) -> None:
    needed, scans = rule
    random = np.random.default_rng(4)
    runs = 20_000
    of, state = tracker(method, confirm=list(rule)), None
    for k in range(scans):
        # The detection that starts the track is certain.
        seen = (random.random((1, runs)) < probability) | (k == 0)
        place = np.array([[[30.0]], [[10.0]]]) + 0.15 * random.normal(size=(2, 1, runs))
        state, tracks = of.step(state, lidar(0.1 * k, place, seen, probability))
    share = np.mean((tracks.ids >= 0).any(axis=0))
    left = scans - 1
    expected = sum(
        comb(left, hits) * probability**hits * (1 - probability) ** (left - hits)
        for hits in range(needed - 1, left + 1)
    )
    assert abs(share - expected) < 4 * np.sqrt(expected * (1 - expected) / runs)


def expected_confirmation(rule: tuple[int, int], probability: float, density: float, gate: float, dt: float) -> float:
    """Of a track that a false alarm started: the sum over the sequences of hits and misses that confirm it.

    A scan is a hit if there is a false alarm where an object is likelier than none: within the gate, and within the
    distance at which the likelihood ratio of the detection and a miss is one.
    """
    needed, scans = rule
    noise = np.diag(NOISE["lidar"])
    f, h = np.eye(4) + dt * np.eye(4, k=2), np.eye(2, 4)
    g = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
    total = 0.0
    for hits in product((True, False), repeat=scans - 1):
        p, chance, found, missed = np.diag([*NOISE["lidar"], VELOCITY_SIGMA**2, VELOCITY_SIGMA**2]), 1.0, 1, 0
        for number, hit in enumerate(hits):
            p = f @ p @ f.T + g @ g.T
            s = h @ p @ h.T + noise
            root = np.sqrt(np.linalg.det(s))
            likely = 2 * np.log(probability / (density * 2 * np.pi * root * (1 - probability * gate)))
            radius = min(float(2 * gammaincinv(1, gate)), likely)
            one = 1 - np.exp(-density * np.pi * radius * root)
            chance *= one if hit else 1 - one
            if hit:
                gain = p @ h.T @ np.linalg.inv(s)
                p = p - gain @ s @ gain.T
            found, missed = found + hit, missed + (not hit)
            if found == needed:
                # What comes later no longer matters: count this beginning once.
                total += chance if not any(hits[number + 1 :]) else 0.0
                break
            if missed > scans - needed:
                break
    return total


@pytest.mark.parametrize("rule", [(2, 2), (2, 3)])
def test_the_rate_of_false_tracks_in_an_empty_scene(rule: tuple[int, int]) -> None:
    random = np.random.default_rng(6)
    clutter, runs, steps, probability, dt = 20.0, 100, 150, 0.9, 0.1
    of, state = tracker(confirm=list(rule), delete_after_s=0.15), None
    alarms = begun = 0
    for k in range(steps):
        scan, origins = one_scan(random, "lidar", k * dt, np.zeros((4, 0)), runs, probability, clutter)
        state, _ = of.step(state, scan)
        # Of the tracks that begin last it is not settled whether they are confirmed.
        if k <= steps - rule[1]:
            alarms += np.count_nonzero(origins != PADDING)
            begun += np.count_nonzero(state.table.evidence[3] == 1)
    assert state is not None
    # All false alarms but those few that a track takes start one.
    assert 0.95 * alarms < begun < alarms
    density = clutter / (np.pi * RANGE**2)
    expected = begun * expected_confirmation(rule, probability, density, 0.9999, dt)
    assert expected > 300
    assert abs(state.next_id.sum() - expected) < 4 * np.sqrt(expected)


def test_a_track_ends_so_long_after_its_latest_detection() -> None:
    seen = traffic(vehicles(3, spacing=40.0), 20, detection=1.0, clutter=0.0, sensors=("lidar",))
    last = scan_of_run(seen.scans[-1], 0)
    of, state = tracker(delete_after_s=0.32), None
    for scan in seen.scans:
        state, tracks = of.step(state, scan_of_run(scan, 0))
    assert len(tracks.ids) == 3
    counts = []
    for k in range(1, 10):
        empty = last._replace(time=last.time + 0.05 * k, measurement=np.zeros((2, 0)), valid=np.zeros(0, dtype=bool))
        state, tracks = of.step(state, empty)
        counts.append(len(tracks.ids))
    assert counts == [3] * 6 + [0] * 3


def test_the_score_confirms_and_deletes() -> None:
    seen = traffic(vehicles(1), 12, detection=1.0, clutter=2.0, sensors=("lidar",), seed=2)
    of, state = tracker(confirm="score"), None
    confirmed, scores = [], []
    for scan in seen.scans:
        stated = scan._replace(detection_probability=0.9)
        state, tracks = of.step(state, scan_of_run(stated, 0))
        confirmed.append(len(tracks.ids) > 0)
        near = np.hypot(*(state.table.belief.mean[:2] - seen.truth[0][:2, :1])) < 3
        scores.append(state.table.evidence[4, near].max())
    assert confirmed == [score >= 12.0 for score in scores]
    assert 1 <= confirmed.index(True) <= 3
    largest = scores[-1]
    last = scan_of_run(seen.scans[-1], 0)
    counts = []
    for k in range(1, 7):
        empty = last._replace(
            time=last.time + 0.05 * k, measurement=np.zeros((2, 0)), valid=np.zeros(0, dtype=bool),
            detection_probability=0.9,
        )  # fmt: skip
        state, tracks = of.step(state, empty)
        counts.append(len(tracks.ids))
    # Each miss takes ln 10.
    assert largest > 12.0
    assert counts == [1, 1, 1, 1, 0, 0]


@pytest.mark.parametrize("method", ["jipda", "pmb"])
def test_a_hidden_object_may_exist(method: str) -> None:
    """Existence and visibility follow the three states of a Markov chain: visible, hidden, gone."""
    seen = traffic(vehicles(1), 10, detection=1.0, clutter=5.0, sensors=("lidar",), seed=3)
    dt, detection, gate, lifetime, visible_s, hidden_s = 0.05, 0.9, 0.9999, 60.0, 5.0, 1.0
    of, state = tracker(method, visible_s=visible_s, lifetime_s=lifetime), None
    for scan in seen.scans:
        state, tracks = of.step(state, scan_of_run(scan._replace(detection_probability=detection), 0))
    real = int(np.argmax(state.table.evidence[0]))
    exists, visible = state.table.evidence[:2, real]
    chances = np.array([exists * visible, exists * (1 - visible), 1 - exists])
    rates = np.array([[-1 / visible_s, 1 / hidden_s], [1 / visible_s, -1 / hidden_s]])
    values, vectors = np.linalg.eig(rates)
    move = (vectors * np.exp(values * dt)) @ np.linalg.inv(vectors)
    last = scan_of_run(seen.scans[-1], 0)
    for k in range(1, 9):
        empty = last._replace(
            time=last.time + dt * k, measurement=np.zeros((2, 0)), valid=np.zeros(0, dtype=bool),
            detection_probability=detection,
        )  # fmt: skip
        state, tracks = of.step(state, empty)
        there = np.exp(-dt / lifetime) * move @ chances[:2]
        chances = np.array([there[0] * (1 - detection * gate), there[1], 1 - there.sum()])
        chances /= chances.sum()
        assert tracks.existence is not None
        np.testing.assert_allclose(tracks.existence[0], chances[:2].sum(), rtol=1e-9)
    # Eight misses of a visible object would leave 1e-5 or so.
    assert 0.5 < tracks.existence[0] < 0.99
