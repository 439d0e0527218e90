"""HOTA, CLEAR and identity scores against the TrackEval package."""

from __future__ import annotations

import numpy as np
import pytest
from tests.metrics.traffic.sequences import Similarities, random_sequence
from tests.support import scored_sequences
from trackeval.metrics import CLEAR, HOTA, Identity

from trackbench.metrics.traffic import score_run
from trackbench.metrics.traffic.mot_metrics import clear_matches, hota, identity, switches, track_of_each

QUIET = {"PRINT_CONFIG": False}
LEAST = 0.5


def our_scores(data: Similarities) -> dict[str, float]:
    pairs, similarity = data.pairs(1e-300)
    found = hota(pairs, similarity, *data.counts())
    near, similarity = data.pairs(LEAST)
    true, missed, false = identity(near, *data.counts())
    chosen = clear_matches(near, similarity, data.objects, data.tracks)
    track_of = track_of_each(near.where(chosen), data.objects.shape)
    matched, switched = int(chosen.sum()), len(switches(track_of).instant)
    due = data.objects.sum()
    return {
        "HOTA": found.hota.mean(),
        "DetA": found.detection.mean(),
        "AssA": found.association.mean(),
        "IDTP": true,
        "IDFN": missed,
        "IDFP": false,
        "IDF1": 2 * true / (2 * true + missed + false),
        "CLR_TP": matched,
        "IDSW": switched,
        "MOTA": (matched - (data.tracks.sum() - matched) - switched) / due,
        "MOTP_sum": similarity[chosen].sum(),
    }


def their_scores(data: Similarities) -> dict[str, float]:
    sequence = data.for_trackeval()
    found = (
        HOTA().eval_sequence(sequence) | Identity(QUIET).eval_sequence(sequence) | CLEAR(QUIET).eval_sequence(sequence)
    )
    return {name: float(np.mean(found[name])) for name in our_scores(data)}


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning:trackeval")
@pytest.mark.parametrize("first", range(0, 500, 50))
def test_random_sequences_score_as_in_trackeval(first: int) -> None:
    for seed in range(first, first + 50):
        data = random_sequence(seed)
        assert our_scores(data) == pytest.approx(their_scores(data), abs=1e-12), seed


def test_positions_score_as_their_similarities_do_in_trackeval() -> None:
    truth, tracks = scored_sequences.sequence(250, 12)
    theirs = scored_sequences.their_scores(scored_sequences.for_trackeval(truth, tracks))
    assert scored_sequences.our_scores(truth, tracks) == pytest.approx(theirs, abs=1e-12)
    values = score_run(truth, tracks).values
    assert [values[path][0] / values[path][1] for path in ("hota", "mota", "idf1")] == pytest.approx(theirs, abs=1e-12)
    assert values["id_switches"][0] > 0
