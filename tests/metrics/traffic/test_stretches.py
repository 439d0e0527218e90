"""A run cut into stretches: what each adds is a part of the run's sums."""

from __future__ import annotations

import numpy as np
import pytest
from tests.metrics.traffic.histories import random_histories, tracks_of, truth_of

from trackbench.metrics.traffic import (
    TRACK_METRICS,
    Associations,
    TrackedRun,
    TrackHistory,
    TrafficScoreOptions,
    TruthHistory,
    score_run,
)
from trackbench.metrics.traffic.run import in_stretches

NAN = np.nan
#: Metrics that are a sum over instants, each by itself.
OF_INSTANTS = ("gospa", "gospa_missed", "gospa_false")


def cut(truth: TruthHistory, tracks: TrackHistory, *ends: int, taken: Associations | None = None) -> list[TrackedRun]:
    scores = score_run(truth, tracks, TrafficScoreOptions(), taken, None, ends)
    return in_stretches(TrackedRun(truth, tracks, taken, scores), ends)


def test_the_sums_of_the_stretches_are_those_of_the_run() -> None:
    rng = np.random.default_rng(0)
    for _ in range(3):
        truth, tracks = random_histories(rng, 30, 3, 4, 20.0)
        origin = rng.integers(-2, 3, tracks.ids.shape)
        taken = Associations(np.arange(30), tracks.ids, origin, np.ones(truth.status.shape, dtype=bool))
        whole = score_run(truth, tracks, associations=taken).values
        assert set(whole) == set(TRACK_METRICS)
        for ends in ((30,), (7, 30), (10, 11, 20, 30)):
            parts = cut(truth, tracks, *ends, taken=taken)
            for path, sums in whole.items():
                total = np.sum([part.scores.values.get(path, (0, 0)) for part in parts], axis=0)
                np.testing.assert_allclose(total, sums, rtol=1e-9, atol=1e-9, err_msg=path)


def test_what_is_of_each_instant_is_that_of_the_stretch_alone() -> None:
    truth, tracks = random_histories(np.random.default_rng(1), 30, 4, 5, 20.0)
    for part in cut(truth, tracks, 12, 30):
        alone = score_run(part.truth, part.tracks)
        for path in OF_INSTANTS:
            assert part.scores.values[path] == pytest.approx(alone.values[path]), path
        np.testing.assert_array_equal(part.scores.gospa.total, alone.gospa.total)


def test_a_switch_between_two_stretches_counts_once_and_in_the_later() -> None:
    truth = truth_of([[0.0]] * 12)
    first, second, third = cut(truth, tracks_of([[0.0, NAN]] * 6 + [[NAN, 0.0]] * 6, ids=[[7, 9]] * 12), 4, 6, 12)
    counts = [part.scores.values.get("id_switches", (0.0, 0.0))[0] for part in (first, second, third)]
    assert counts == [0, 0, 1]
    cost = TrafficScoreOptions().switch(0.5) ** 2
    assert [part.scores.values.get("gospa_switch", (0, 0))[0] for part in (first, second, third)] == [0, 0, cost]
    assert [event.instant for event in third.scores.events if event.kind == "switched"] == [0]
    # It waits for its track over a border, and gets one.
    waits = cut(truth, tracks_of([[NAN]] * 6 + [[0.0]] * 6), 4, 12)
    assert [part.scores.values["never_confirmed"] for part in waits] == [(0, 1), (0, 0)]
    # One track over both is no new one.
    assert sum(part.scores.values["confirm_latency"][1] for part in cut(truth, tracks_of([[0.0]] * 12), 6, 12)) == 1
