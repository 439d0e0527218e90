"""Tracks where nothing counts are neither right nor false."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.base.types import DUE, Array
from trackbench.metrics.traffic import TrackHistory, TruthHistory, score_run

STEPS = 10


def truth(x: float) -> TruthHistory:
    state = np.zeros((4, STEPS, 1))
    state[0] = x
    return TruthHistory(np.arange(STEPS, dtype=float), state, np.full((STEPS, 1), DUE, dtype=np.int8))


def tracks(*x: float) -> TrackHistory:
    mean = np.zeros((4, STEPS, len(x)))
    mean[0] = np.array(x)
    covariance = np.broadcast_to(np.eye(4)[:, :, None, None], (4, 4, STEPS, len(x)))
    return TrackHistory(np.tile(np.arange(len(x)), (STEPS, 1)), mean, covariance)


def mask(*columns: bool) -> Array:
    return np.tile(np.array(columns), (STEPS, 1))


def test_a_false_track_where_nothing_counts_changes_no_score() -> None:
    alone = score_run(truth(0), tracks(0.5)).values
    beside = score_run(truth(0), tracks(0.5, 50), unscored=mask(False, True)).values
    assert beside == alone
    assert score_run(truth(0), tracks(0.5, 50)).values["gospa_false"][0] > 0


def test_a_track_of_a_due_object_counts_wherever_it_is() -> None:
    expected = score_run(truth(0), tracks(0.5)).values
    assert score_run(truth(0), tracks(0.5), unscored=mask(True)).values == expected


@pytest.mark.parametrize("counting", [0, 1, STEPS])
def test_a_track_is_false_if_it_counts_at_some_time(counting: int) -> None:
    where = np.arange(STEPS)[:, None] >= counting
    values = score_run(truth(0), tracks(50), unscored=where).values
    assert values["false_tracks"][0] == (counting > 0)
    assert values.get("gospa_false", (0,))[0] == counting * 5.0**2 / 2
