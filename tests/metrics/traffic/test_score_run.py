"""All scores of one run: what each says in cases that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from tests.metrics.traffic.histories import STEP, random_histories, tracks_of, truth_of

from trackbench.base.types import ABSENT, DUE, FALSE_ALARM, OPTIONAL
from trackbench.metrics.traffic import TRACK_METRICS, Associations, RunScores, TrackHistory, TruthHistory, score_run
from trackbench.metrics.traffic.assignment import NO_DETECTION
from trackbench.metrics.traffic.events import LOST, NOT_DUE, SWITCHED, TRACKED, WAITING

NAN = np.nan


def ratios(scores: RunScores) -> dict[str, float]:
    """The values as they stand in a result of this one run."""
    found = {path: total / count for path, (total, count) in scores.values.items() if count}
    return {path: value**0.5 if TRACK_METRICS[path].combine == "root" else value for path, value in found.items()}


def associations_of(truth: TruthHistory, tracks: TrackHistory, origin: object) -> Associations:
    """One scan an instant, in which every object was detected."""
    every = np.ones(truth.status.shape, dtype=bool)
    return Associations(np.arange(len(truth.time)), tracks.ids, np.asarray(origin), every)


def test_an_object_that_is_never_tracked() -> None:
    truth = truth_of([[0.0]] * 8)
    scores = score_run(truth, tracks_of([[NAN]] * 8))
    found = ratios(scores)
    assert found["gospa"] == found["gospa_missed"] == found["tgospa"] == pytest.approx((5.0**2 / 2) ** 0.5)
    assert scores.values["confirm_latency"] == (8 * STEP, 0)
    assert found["never_confirmed"] == 1
    assert (found["matched_share"], found["hota"], found["idf1"], found["mota"]) == (0, 0, 0, 0)
    assert not {"position_rmse", "nees", "lost_time_share"} & set(found)
    (event,) = scores.events
    assert (event.kind, event.why, event.cost) == ("lost", "it never had a track", 8 * 12.5)
    assert np.all(scores.strips == WAITING)


def test_a_run_without_any_column_of_tracks_is_missed_altogether() -> None:
    scores = score_run(truth_of([[0.0]] * 8), tracks_of(np.zeros((8, 0))))
    assert [(event.kind, event.cost) for event in scores.events] == [("lost", 8 * 12.5)]


@pytest.mark.parametrize(("objects", "columns"), [(0, 0), (0, 2), (2, 0), (1, 1)])
def test_nothing_to_score_gives_no_value_and_no_fault(objects: int, columns: int) -> None:
    truth, tracks = truth_of(np.full((4, objects), NAN)), tracks_of(np.full((4, columns), NAN))
    found = ratios(score_run(truth, tracks))
    assert found["gospa"] == found["tgospa"] == found["false_tracks"] == 0
    assert not {"hota", "idf1", "mota", "matched_share", "id_switches", "confirm_latency"} & set(found)


def test_a_track_on_an_optional_object_is_neither_right_nor_wrong() -> None:
    x = np.tile([0.0, 30.0, 60.0], (12, 1))
    status = np.tile([DUE, OPTIONAL, ABSENT], (12, 1))
    truth = truth_of(x, status)
    without = score_run(truth, tracks_of(x[:, :1] + 0.5))
    with_it = score_run(truth, tracks_of(np.hstack([x[:, :1] + 0.5, x[:, 1:2] + 2])))
    assert with_it.values == without.values
    assert {event.kind for event in with_it.events} == {"born", "confirmed"}
    # Where nothing is, a track is wrong.
    wrong = score_run(truth, tracks_of(np.hstack([x[:, :1] + 0.5, x[:, 2:]])))
    assert ratios(wrong)["gospa_false"] == pytest.approx(12.5**0.5)
    # A missed optional object costs nothing, whatever the status was before.
    status[6:, 0] = OPTIONAL
    gone = x[:, :1].copy()
    gone[6:] = NAN
    found = ratios(score_run(truth_of(x, status), tracks_of(gone)))
    assert (found["gospa"], found["lost_time_share"]) == (0, 0)


def test_an_optional_object_takes_no_track_from_a_due_one() -> None:
    truth = truth_of([[0.0, 4.0]] * 3, [[DUE, OPTIONAL]] * 3)
    found = ratios(score_run(truth, tracks_of([[2.4]] * 3)))
    assert (found["matched_share"], found["gospa"]) == (1, pytest.approx(2.4))
    # Further than half of the cutoff it is not on the due object any more: there it is missed, and no track is false.
    further = ratios(score_run(truth, tracks_of([[3.5]] * 3)))
    assert (further["matched_share"], further["mota"], further["gospa"]) == (0, 0, pytest.approx(3.5))
    # With a track each, both are where they belong.
    assert ratios(score_run(truth, tracks_of([[0.5, 3.5]] * 3)))["gospa"] == pytest.approx(0.5)


def test_an_optional_object_excuses_one_track_alone() -> None:
    truth = truth_of([[0.0]] * 4, [[OPTIONAL]] * 4)
    scores = score_run(truth, tracks_of([[-1.0, -0.5, 0.0, 0.5, 1.0, 1.5]] * 4))
    assert ratios(scores)["gospa_false"] == pytest.approx((5 * 12.5) ** 0.5)
    assert sum(event.kind == "false" for event in scores.events) == 5
    assert scores.values["false_tracks"][0] == 5


def test_a_second_track_on_a_due_object_is_false_though_a_hidden_one_is_seven_metres_away() -> None:
    truth = truth_of([[0.0, 7.0]] * 4, [[DUE, OPTIONAL]] * 4)
    found = ratios(score_run(truth, tracks_of([[0.0, 1.9]] * 4)))
    assert found["gospa_false"] == pytest.approx(12.5**0.5)
    # Within the cutoff of the hidden one GOSPA excuses it; CLEAR, up to half of it, does not.
    found = ratios(score_run(truth, tracks_of([[0.0, 2.1]] * 4)))
    assert (found["gospa_false"], found["mota"], found["idf1"]) == (0, 0, pytest.approx(2 / 3))


def test_a_switch() -> None:
    truth = truth_of([[0.0]] * 12)
    scores = score_run(truth, tracks_of([[0.0, NAN]] * 6 + [[NAN, 0.0]] * 6, ids=[[7, 9]] * 12))
    found = ratios(scores)
    assert found["id_switches"] == pytest.approx(1 / (12 * STEP / 60))
    assert found["mota"] == pytest.approx(11 / 12)
    assert found["idf1"] == pytest.approx(0.5)
    assert found["gospa_switch"] == pytest.approx((0.5 / STEP * 12.5 / 12) ** 0.5)
    (event,) = [event for event in scores.events if event.kind == "switched"]
    assert (event.instant, event.time, event.track, event.other_track) == (6, 3.0, 9, 7)
    assert event.why == "its former track ended"
    assert scores.strips[:, 0].tolist() == [TRACKED] * 6 + [SWITCHED] + [TRACKED] * 5


def test_two_tracks_that_change_places() -> None:
    truth = truth_of([[0.0, 30.0]] * 8)
    scores = score_run(truth, tracks_of([[0.0, 30.0]] * 4 + [[30.0, 0.0]] * 4))
    changes = [event for event in scores.events if event.kind == "switched"]
    assert [(event.object, event.track, event.other_track, event.other_object) for event in changes] == [
        (0, 1, 0, 1),
        (1, 0, 1, 0),
    ]


def test_latency_loss_and_fragmentation() -> None:
    truth = truth_of([[0.0, NAN]] * 2 + [[0.0, 30.0]] * 14)
    x = np.full((16, 2), NAN)
    x[4:10, 0] = x[12:, 0] = 1.0
    x[2:, 1] = 30.0
    scores = score_run(truth, tracks_of(x))
    found = ratios(scores)
    assert found["confirm_latency"] == pytest.approx(2 * STEP)
    assert found["never_confirmed"] == 0
    assert found["lost_time_share"] == pytest.approx(2 / (12 + 14))
    assert found["matched_share"] == pytest.approx((10 + 14) / (16 + 14))
    assert found["position_rmse"] == pytest.approx((10 / 24) ** 0.5)
    assert found["nees"] == pytest.approx(10 / 24)
    expected = [NOT_DUE] * 0 + [WAITING] * 4 + [TRACKED] * 6 + [LOST] * 2 + [TRACKED] * 4
    assert scores.strips[:, 0].tolist() == expected
    assert scores.strips[:, 1].tolist() == [NOT_DUE] * 2 + [TRACKED] * 14
    of_first = [(event.kind, event.instant, event.cost) for event in scores.events if event.object == 0]
    assert of_first == [
        ("born", 4, 0.0),
        ("confirmed", 4, 4 * 12.5),
        ("lost", 10, 2 * 12.5),
        ("fragmented", 12, 0.0),
    ]


def test_an_object_that_is_never_tracked_adds_its_waiting_and_no_confirmation() -> None:
    # The second object is due for a quarter of the run, shorter than the first one waits, and is never tracked.
    x = np.tile([0.0, NAN], (16, 1))
    x[:4, 1] = 30.0
    first = np.full((16, 1), NAN)
    first[6:] = 0.0
    scores = score_run(truth_of(x), tracks_of(first))
    assert scores.values["confirm_latency"] == ((6 + 4) * STEP, 1)
    assert scores.values["never_confirmed"] == (1, 2)


def test_one_instant_decides_the_mean_of_nees_and_not_the_share_within_the_bound() -> None:
    truth, tracks = truth_of([[0.0]] * 100), tracks_of([[0.0]] * 100)
    tracks.mean[2, 0] = 50.0
    found = ratios(score_run(truth, tracks))
    assert (found["nees"], found["nees_inside"]) == pytest.approx((25.0, 0.99))


def test_two_objects_with_one_track_between_them_are_merged() -> None:
    truth = truth_of([[0.0, 8.0]] * 4 + [[2.0, 6.0]] * 4)
    tracks = tracks_of([[0.0, 8.0]] * 4 + [[2.0, NAN]] * 4)
    kinds = {event.kind: event for event in score_run(truth, tracks).events}
    assert kinds["lost"].why == "its track ended"
    beside = tracks_of([[0.0, 8.0]] * 4 + [[2.0, 0.5]] * 4)
    (event,) = [event for event in score_run(truth, beside).events if event.kind == "merged"]
    assert (event.object, event.track, event.other_object, event.other_track) == (1, 1, 0, 0)


def test_false_tracks() -> None:
    truth = truth_of([[0.0]] * 12)
    x = np.full((12, 3), NAN)
    x[:, 0] = 0.0
    x[2:5, 1] = 50.0
    x[6:, 2] = np.linspace(1.0, 51.0, 6)
    scores = score_run(truth, tracks_of(x))
    found = ratios(scores)
    # Of the second it cannot be said that it never was near the object, but the first track was nearer.
    assert found["false_tracks"] == pytest.approx(2 / (12 * STEP / 60))
    events = [(event.track, event.instant, event.cost, event.x) for event in scores.events if event.kind == "false"]
    assert events == [(1, 2, 3 * 12.5, 50.0), (2, 6, 6 * 12.5, 1.0)]


def assert_costs_are_gospas(scores: RunScores) -> None:
    missed = sum(event.cost for event in scores.events if event.kind in ("confirmed", "lost", "merged", "fragmented"))
    assert missed == pytest.approx(scores.values["gospa_missed"][0])
    assert missed == pytest.approx(scores.gospa.missed.sum())
    false = sum(event.cost for event in scores.events if event.kind == "false")
    assert false == pytest.approx(scores.values["gospa_false"][0])


@pytest.mark.parametrize("spread", [8.0, 30.0, 100.0])
@pytest.mark.parametrize("seed", range(7))
def test_events_account_for_all_that_gospa_finds_missed_and_false(seed: int, spread: float) -> None:
    truth, tracks = random_histories(np.random.default_rng(seed), 40, 6, 7, spread)
    status = truth.status.copy()
    status[np.random.default_rng(seed).random(status.shape) < 0.2] = OPTIONAL
    truth = truth._replace(status=np.where(truth.status == ABSENT, ABSENT, status))
    scores = score_run(truth, tracks)
    assert_costs_are_gospas(scores)
    assert sum(event.kind == "switched" for event in scores.events) == scores.values["id_switches"][0]
    assert [event.instant for event in scores.events] == sorted(event.instant for event in scores.events)


def test_associations_are_judged_by_the_object_that_the_track_had_before() -> None:
    truth = truth_of([[0.0, 8.0]] * 6)
    # At the fourth instant track 0 takes the detection of object 1 and jumps to it.
    tracks = tracks_of([[0.0, NAN]] * 3 + [[8.0, NAN]] * 3)
    origin = [[0, NO_DETECTION]] * 2 + [[FALSE_ALARM, NO_DETECTION]] + [[1, NO_DETECTION]] * 2 + [[NO_DETECTION] * 2]
    found = score_run(truth, tracks, associations=associations_of(truth, tracks, origin)).values
    shares = {path.removeprefix("association_"): sums[0] for path, sums in found.items() if "association" in path}
    assert shares == {"right": 3, "wrong_object": 1, "clutter": 1, "missed": 1}


def test_a_detection_of_two_objects_is_right_for_both_and_silence_is_no_miss_where_nothing_was_detected() -> None:
    truth = truth_of([[0.0, 4.0]] * 3)
    tracks = tracks_of(truth.state[0])
    taken = associations_of(truth, tracks, [[0, 0], [0, NO_DETECTION], [NO_DETECTION, 1]])
    taken = taken._replace(merged=np.array([[1, 1], [-1, -1], [-1, -1]]))
    taken.detected[1, 1] = False
    found = score_run(truth, tracks, associations=taken).values
    assert found["association_right"] == (4, 5)
    assert found["association_missed"] == (1, 5)


def test_from_half_of_the_cutoff_on_a_track_is_near_an_object_but_not_on_it() -> None:
    truth = truth_of([[0.0]] * 4)
    on, near, far = (ratios(score_run(truth, tracks_of([[x]] * 4))) for x in (2.5, 2.6, 5.1))
    assert (on["matched_share"], near["matched_share"], near["idf1"], near["mota"]) == (1, 0, 0, -1)
    assert (near["gospa"], near["gospa_missed"]) == (pytest.approx(2.6), 0)
    assert near["hota"] > 0 == far["hota"]
    assert far["gospa"] == pytest.approx(5.0)


def test_columns_and_the_numbers_of_ids_mean_nothing() -> None:
    rng = np.random.default_rng(3)
    truth, tracks = random_histories(rng, 25, 4, 6, 20.0)
    order = np.argsort(rng.random(tracks.ids.shape), axis=1)
    shuffled = TrackHistory(
        np.take_along_axis(np.where(tracks.ids >= 0, 1000 - tracks.ids, -1), order, axis=1),
        np.take_along_axis(tracks.mean, order[None], axis=2),
        tracks.covariance,
    )
    assert ratios(score_run(truth, shuffled)) == pytest.approx(ratios(score_run(truth, tracks)))


def test_a_mean_that_is_not_finite_is_on_no_object() -> None:
    truth, tracks = truth_of([[0.0]] * 4), tracks_of([[0.0, 0.0]] * 4)
    tracks.mean[:, :, 1] = NAN
    found = ratios(score_run(truth, tracks))
    assert found["gospa_false"] == pytest.approx(12.5**0.5)
    assert found["position_rmse"] == 0
