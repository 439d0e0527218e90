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


def _own_case(objects: list[str], tracks: list[str], alike: dict[tuple[int, int], str]) -> Similarities:
    similarity = np.zeros((5, len(objects), len(tracks)))
    for (item, track), when in alike.items():
        similarity[:, item, track] = [int(digit) for digit in when]
    there = [np.array([[digit == "1" for digit in row] for row in rows]).T for rows in (objects, tracks)]
    return Similarities(similarity, there[0], there[1])


APART = {(0, 1): "00011", (1, 0): "11000"}
#: Name, case, MOTA, IDF1, HOTA.
OWN_CASES = [
    ("no_confusion", _own_case(["11111", "11100"], ["11110", "11111"], APART), -0.125, 8 / 17, 0.316228),
    (
        "with_confusion",
        _own_case(["11111", "11100"], ["11110", "11111"], {**APART, (0, 0): "00100", (1, 1): "01000"}),
        0.0,
        8 / 17,
        0.344601,
    ),
    (
        "split_tracks",
        _own_case(
            ["11011", "11111"],
            ["11000", "00111", "00001", "00111", "11000"],
            {(0, 0): "11000", (0, 3): "00011", (1, 1): "00110", (1, 2): "00001", (1, 4): "11000"},
        ),
        4 / 9,
        0.4,
        0.561384,
    ),
]


@pytest.mark.parametrize(("data", "mota", "idf1", "hota_value"), [case[1:] for case in OWN_CASES])
def test_trackevals_own_cases(data: Similarities, mota: float, idf1: float, hota_value: float) -> None:
    found = our_scores(data)
    assert found == pytest.approx(their_scores(data), abs=1e-12)
    assert found["MOTA"] == pytest.approx(mota, abs=1e-12)
    assert found["IDF1"] == pytest.approx(idf1, abs=1e-12)
    assert found["HOTA"] == pytest.approx(hota_value, abs=1e-6)


def test_positions_score_as_their_similarities_do_in_trackeval() -> None:
    truth, tracks = scored_sequences.sequence(250, 12)
    theirs = scored_sequences.their_scores(scored_sequences.for_trackeval(truth, tracks))
    assert scored_sequences.our_scores(truth, tracks) == pytest.approx(theirs, abs=1e-12)
    values = score_run(truth, tracks).values
    assert [values[path][0] / values[path][1] for path in ("hota", "mota", "idf1")] == pytest.approx(theirs, abs=1e-12)
    assert values["id_switches"][0] > 0
