"""Tracks on optional objects, against enumeration, and what is left of them against TrackEval."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from tests.metrics.traffic.histories import random_histories
from tests.support.gospa import gospa_of_sets
from trackeval.metrics import CLEAR, HOTA, Identity

from trackbench.base.types import DUE, OPTIONAL
from trackbench.metrics.traffic import TrackHistory, TruthHistory, score_run
from trackbench.metrics.traffic.assignment import Counted, count_by_gospa, nearby
from trackbench.metrics.traffic.run import count_by_clear
from trackbench.metrics.traffic.set_distances import gospa

QUIET = {"PRINT_CONFIG": False}
CUTOFF = 5.0


def histories(seed: int) -> tuple[TruthHistory, TrackHistory]:
    """Half of the objects are optional."""
    rng = np.random.default_rng(seed)
    truth, tracks = random_histories(rng, 20, 5, 6, 25.0)
    status = np.where((truth.status == DUE) & (rng.random(truth.status.shape) < 0.5), OPTIONAL, truth.status)
    return truth._replace(status=status.astype(np.int8)), tracks


def enumerated(left: list[float], optional: list[float], reach: float) -> float:
    """The smallest sum of distances, where a track left over costs the reach."""
    places = [*optional, *[np.inf] * len(left)]
    orders = itertools.permutations(places, len(left))
    return min(sum(min(abs(x - y), reach) for x, y in zip(left, order, strict=True)) for order in orders)


@pytest.mark.parametrize("by", [count_by_gospa, count_by_clear])
@pytest.mark.parametrize("seed", range(6))
def test_what_no_due_object_has_is_matched_with_the_optional_ones(seed: int, by: object) -> None:
    truth, tracks = histories(seed)
    assert callable(by)
    counted: Counted = by(nearby(truth, tracks, CUTOFF))
    excused = 0
    for k in range(len(truth.time)):
        on_due = set(counted.matched.column[counted.matched.instant == k].tolist())
        free = [column for column in np.flatnonzero(tracks.ids[k] >= 0).tolist() if column not in on_due]
        now = counted.excused.where(counted.excused.instant == k)
        assert set(now.column.tolist()) <= set(free)
        assert len(set(now.object.tolist())) == len(now.object)
        assert np.all(truth.status[k, now.object] == OPTIONAL)
        assert np.array_equal(np.flatnonzero(counted.present[k]), sorted({*on_due, *free} - set(now.column.tolist())))
        cost = now.distance.sum() + counted.reach * (len(free) - len(now.column))
        places = truth.state[0, k, truth.status[k] == OPTIONAL].tolist()
        assert cost == pytest.approx(enumerated(tracks.mean[0, k, free].tolist(), places, counted.reach))
        excused += len(now.column)
    assert excused > 5


@pytest.mark.parametrize("seed", range(6))
def test_gospa_is_that_of_the_due_objects_and_the_other_tracks(seed: int) -> None:
    truth, tracks = histories(seed)
    counted = count_by_gospa(nearby(truth, tracks, CUTOFF))
    objects = np.where(truth.status == DUE, truth.state[:2], np.nan)
    expected = gospa_of_sets(objects, np.where(counted.present, tracks.mean[:2], np.nan), CUTOFF)
    for ours, theirs in zip(gospa(counted), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_hota_clear_and_identity_are_trackevals_of_what_is_left(seed: int) -> None:
    truth, tracks = histories(seed)
    counted = count_by_clear(nearby(truth, tracks, CUTOFF))
    distance = np.abs(truth.state[0, :, :, None] - tracks.mean[0, :, None])
    objects, columns = ([np.flatnonzero(now) for now in mask] for mask in (counted.due, counted.present))
    sequence = {
        "num_timesteps": len(truth.time),
        "num_gt_ids": counted.due.shape[1],
        "num_tracker_ids": len(counted.ids),
        "num_gt_dets": int(counted.due.sum()),
        "num_tracker_dets": int(counted.present.sum()),
        "gt_ids": objects,
        "tracker_ids": [counted.track[k, own] for k, own in enumerate(columns)],
        "similarity_scores": [
            np.maximum(0, 1 - distance[k][np.ix_(i, j)] / CUTOFF)
            for k, (i, j) in enumerate(zip(objects, columns, strict=True))
        ],
    }
    values = score_run(truth, tracks).values
    ours = [values[path][0] / values[path][1] for path in ("hota", "mota", "idf1")]
    found = [metric.eval_sequence(sequence) for metric in (HOTA(), CLEAR(QUIET), Identity(QUIET))]
    theirs = [np.mean(found[0]["HOTA"]), found[1]["MOTA"], found[2]["IDF1"]]
    assert ours == pytest.approx(theirs, abs=1e-12)
    assert len(counted.excused.instant) > 5
