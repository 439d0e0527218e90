"""The sums of a function's decisions, from decisions that are made up."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.metrics.intervals import Interval, clustered
from trackbench.subjects.functions.emergency_braking import EmergencyBraking
from trackbench.subjects.functions.following_distance import FollowingDistance
from trackbench.subjects.functions.forward_collision_warning import ForwardCollisionWarning
from trackbench.subjects.functions.metrics import function_metrics
from trackbench.subjects.functions.protocol import Decision
from trackbench.subjects.functions.sums import Decisions, FunctionScores, score_decisions

TIME = np.arange(0.0, 10.0, 0.1)


def decided(*spans: tuple[float, float] | None, quantity: float = 1.0) -> Decision:
    """A run for each span, in which it is active from one time up to another."""
    ends = [span or (1.0, 0.0) for span in spans]
    active = np.stack([(start - 1e-9 <= TIME) & (end - 1e-9 > TIME) for start, end in ends], axis=1)
    return Decision(active, np.where(active, 0, -1), np.where(active, quantity, np.nan))


def scores(
    truth: Decision, tracks: Decision, overlap: float = np.inf, function: type = ForwardCollisionWarning
) -> FunctionScores:
    hit = np.broadcast_to(TIME[:, None] > overlap - 1e-9, truth.active.shape)
    return score_decisions(Decisions(truth, tracks, tracks.object >= 0, hit), TIME, function())


def metric(name: str, sums: FunctionScores, function: type = ForwardCollisionWarning):
    (found,) = [item for item in function_metrics({"f": function()}) if item.name == f"{name}.f"]
    return found.finish(sums)


def test_delays_are_signed_and_a_missing_warning_lasts_to_the_impact():
    truth = decided((2, 6), (2, 6), (2, 6), (2, 6))
    tracks = decided((2.5, 6), (1.0, 6), None, (5.5, 6))
    sums = scores(truth, tracks, overlap=5.0)
    np.testing.assert_allclose(sums.delay, [0.5, -0.5, 3.0, 3.0], atol=1e-9)
    assert sums.missing.tolist() == [False, False, True, True]
    delay = metric("warn_delay", sums)
    assert delay.value == pytest.approx(6.0 / 4)
    details = dict(delay.details)
    assert details["early"] == pytest.approx(-0.5)
    assert details["late"] == pytest.approx(6.5 / 3)
    assert details["missing"] == 0.5
    assert metric("missed_warnings", sums).value == 0.5
    # One begins too early. What comes after the impact is too late, but not false, and no more driving.
    assert metric("false_warnings", sums).value == pytest.approx(1 / (4 * 5.0 / 3600))
    np.testing.assert_allclose(sums.of("hours"), 5.0 / 3600)


def test_without_an_impact_a_missing_warning_lasts_beyond_the_end_of_the_event():
    sums = scores(decided((2, 6), (2, 6)), decided((8, 9), (2, 6)))
    np.testing.assert_allclose(sums.delay, [4.5, 0.0], atol=1e-9)
    assert metric("false_warnings", sums).value == pytest.approx(1 / (2 * 9.9 / 3600))


def test_errors_count_in_the_first_half_second_of_an_event():
    truth, tracks = decided((2, 6), quantity=2.0), decided((2.2, 6), quantity=2.3)
    late = tracks._replace(quantity=np.where(TIME[:, None] > 2.45, 99.0, tracks.quantity))
    assert metric("ttc_error", scores(truth, late)).value == pytest.approx(0.3)


def test_braking_counts_where_either_brakes():
    truth, tracks = decided((2, 4), quantity=6.0), decided((3, 4), quantity=7.0)
    sums = scores(truth, tracks, function=EmergencyBraking)
    expected = np.sqrt((10 * 6.0**2 + 10 * 1.0**2) / 20)
    assert metric("brake_error", sums, EmergencyBraking).value == pytest.approx(expected)


def test_a_wrong_lead_is_another_object_none_or_one_where_there_is_none():
    truth, tracks = decided((2, 4), (2, 4), None, None), decided((2, 4), (3, 4), (5, 6), None)
    tracks.object[(TIME < 2.45) & (TIME > 1.95), 0] = 1
    ghost = tracks._replace(object=np.where(np.arange(4) == 2, -1, tracks.object))
    chose = tracks.object >= 0
    sums = score_decisions(Decisions(truth, ghost, chose, np.zeros_like(chose)), TIME, FollowingDistance())
    assert metric("lead_errors", sums, FollowingDistance).value == pytest.approx((5 + 10 + 10) / (20 + 20 + 10))


def test_scenes_without_an_event_say_nothing_of_the_delay():
    truth = decided((2, 6), *[None] * 9)
    one = metric("warn_delay", scores(truth, decided((2.5, 6), *[None] * 9)))
    value = clustered(one, np.arange(10)).as_value("s")
    assert value.ci95 is None
    assert "fewer than 5 scenes" in value.reason
    delays = [0.5, 0.4, 0.6, 0.5, 0.3]
    some = metric("warn_delay", scores(decided(*[(2, 6)] * 5), decided(*((2 + delay, 6) for delay in delays))))
    padded = [(2 + delay, 6) for delay in delays] + [None] * 5
    sparse = metric("warn_delay", scores(decided(*[(2, 6)] * 5, *[None] * 5), decided(*padded)))
    assert isinstance(some, Interval)
    assert clustered(sparse, np.arange(10)).as_value("s").ci95 == pytest.approx(
        clustered(some, np.arange(5)).as_value("s").ci95
    )


def test_without_any_event_there_is_a_reason():
    sums = scores(decided(None), decided(None))
    for name in ("warn_delay", "warn_error", "missed_warnings", "ttc_error"):
        assert metric(name, sums).value is None
        assert "event" in metric(name, sums).reason
    assert metric("false_warnings", sums).value == 0.0


def test_runs_tell_a_metric_by_their_own_values():
    truth = decided((2, 6), None, (2, 6), (2, 6))
    sums = scores(truth, decided((2.5, 6), None, (2.0, 6), (1.8, 6)))
    (error,) = [item for item in function_metrics({"f": ForwardCollisionWarning()}) if "warn_err" in item.name]
    interval = error.finish(sums)
    assert isinstance(interval, Interval)
    values, count = error.in_runs(error.name, sums, interval, 4).values()
    np.testing.assert_allclose(values, [0.5, np.nan, 0.0, 0.2], atol=1e-9)
    assert count.tolist() == [1, 0, 1, 1]
    again = error.of_runs(values, count)
    assert again is not None
    assert again.value == pytest.approx(interval.value)
    np.testing.assert_allclose(again.influence, interval.influence)
    assert error.of_runs(values[1:2], count[1:2]) is None
