"""Association probabilities against the plain enumeration of all associations."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from trackbench.base.types import Array
from trackbench.trackers.multi.mixture import belief_propagation, enumeration, marginals


def listed(weight: Array) -> Array:
    """``(T, D)`` association probabilities by writing every association down."""
    tracks, detections = weight.shape
    total, found = 0.0, np.zeros_like(weight)
    for choice in product(range(-1, detections), repeat=tracks):
        taken = [d for d in choice if d >= 0]
        if len(taken) != len(set(taken)):
            continue
        probability = np.prod([weight[t, d] for t, d in enumerate(choice) if d >= 0])
        total += probability
        for t, d in enumerate(choice):
            if d >= 0:
                found[t, d] += probability
    return found / total


def weights(random: np.random.Generator, tracks: int, detections: int) -> Array:
    """Of pairs of which some are out of gate."""
    gated = random.random((tracks, detections)) < 0.7
    return np.where(gated, np.exp(random.normal(1.0, 2.5, (tracks, detections))), 0.0)


@pytest.mark.parametrize(("tracks", "detections"), list(product(range(1, 6), repeat=2)))
def test_the_sum_over_sets_equals_the_list_of_all_associations(tracks: int, detections: int) -> None:
    random = np.random.default_rng(10 * tracks + detections)
    several = np.stack([weights(random, tracks, detections) for _ in range(3)], axis=-1)
    found = enumeration(several)
    for k in range(3):
        np.testing.assert_allclose(found[..., k], listed(several[..., k]), rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_clusters_of_many_runs_are_taken_one_by_one(seed: int) -> None:
    random = np.random.default_rng(seed)
    blocks = [weights(random, *random.integers(1, 6, 2)) for _ in range(12)]
    tracks, detections = (sum(block.shape[axis] for block in blocks) for axis in (0, 1))
    whole = np.zeros((tracks, detections))
    expected = np.zeros_like(whole)
    row = column = 0
    for block in blocks:
        own = (slice(row, row + block.shape[0]), slice(column, column + block.shape[1]))
        whole[own], expected[own] = block, listed(block)
        row, column = row + block.shape[0], column + block.shape[1]
    # The tracks and detections of a cluster need not stand together.
    rows, columns = random.permutation(tracks), random.permutation(detections)
    whole, expected = whole[rows][:, columns], expected[rows][:, columns]
    track, detection = np.nonzero(whole)
    found = marginals(track, detection, whole[track, detection], whole.shape, max_cluster=5)
    np.testing.assert_allclose(found, expected[track, detection], rtol=0, atol=1e-12)


def gated_problem(random: np.random.Generator, apart: float) -> Array:
    """The weights of five objects in a square of 12 standard deviations, some not detected, among false alarms."""
    place = np.empty((0, 2))
    while len(place) < 5:
        new = random.uniform(0, 12, (1, 2))
        if len(place) == 0 or np.linalg.norm(place - new, axis=1).min() >= apart:
            place = np.concatenate([place, new])
    seen = (place + random.normal(size=place.shape))[random.random(5) < 0.9]
    detection = np.concatenate([seen, random.uniform(0, 12, (random.poisson(1.44), 2))])
    distance = np.square(place[:, None] - detection).sum(axis=-1)
    likelihood = np.where(distance < 18.4, np.exp(-0.5 * distance) / (2 * np.pi), 0.0)
    return 0.9 / 0.1 * likelihood / 0.01


@pytest.mark.parametrize(("apart", "limit"), [(3.0, 0.01), (0.0, 0.03)])
def test_the_mean_error_of_belief_propagation(apart: float, limit: float) -> None:
    random = np.random.default_rng(1)
    errors = []
    for _ in range(300):
        weight = gated_problem(random, apart)
        track, detection = np.nonzero(weight)
        found = belief_propagation(track, detection, weight[track, detection], weight.shape, np.zeros_like(track))
        errors.append(np.abs(found - enumeration(weight)[track, detection]))
    # Objects that lie on each other make loops, where it is an approximation.
    assert np.mean(np.concatenate(errors)) < limit
    assert np.max(np.concatenate(errors)) > 1e-3


def test_belief_propagation_is_exact_without_loops() -> None:
    # A chain: each detection between two tracks.
    track, detection = np.array([0, 1, 1, 2, 2, 3]), np.array([0, 0, 1, 1, 2, 2])
    weight = np.array([3.0, 1.0, 20.0, 7.0, 0.5, 100.0])
    dense = np.zeros((4, 3))
    dense[track, detection] = weight
    found = belief_propagation(track, detection, weight, (4, 3), np.zeros_like(track))
    np.testing.assert_allclose(found, listed(dense)[track, detection], atol=1e-6)
