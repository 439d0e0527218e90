"""Which condition carries the error."""

from __future__ import annotations

from typing import Any

import pytest

import trackbench as tb
from trackbench.metrics.moments import scene_at
from trackbench.metrics.recorded_run import load_recorded_run
from trackbench.subjects.envelope.causes import condition_of, event_of

CAR: dict[str, Any] = {"start": {"x": 30, "y": 5, "speed_mps": 10}}


def result_of(pieces: list[dict[str, float]]) -> tb.Result:
    """A filter that expects hardly any acceleration."""
    scenario = {
        "name": "turn",
        "truth": {"source": "scripted", "duration_s": 12, "rate_hz": 10, "objects": {"car": {**CAR, "pieces": pieces}}},
        "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.2}},
        "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 0.5}},
        "monte_carlo": {"runs": 10},
    }
    return tb.run(scenario, workers=1)


def test_a_turn_carries_the_error_and_holds_the_worst_moment() -> None:
    result = result_of([{"for_s": 5}, {"for_s": 2, "turn_rate_degps": 30}, {"for_s": 5}])
    said = condition_of(result, "kf")
    breakdown = result["kf"].breakdown
    assert breakdown is not None
    turning, every = breakdown.manoeuvre["turning"], breakdown.all
    assert turning.position_rmse is not None
    assert every.position_rmse is not None
    carried = turning.count * turning.position_rmse.value**2 / (every.count * every.position_rmse.value**2)
    assert said.startswith(f"turning: {100 * carried:.0f} % of the squared position error in ")
    assert event_of(result, "kf").startswith("position error ")
    time = float(event_of(result, "kf").rpartition(" at ")[2].removesuffix(" s"))
    assert 5 < time < 8.5


def test_where_all_conditions_are_alike_none_is_named() -> None:
    assert condition_of(result_of([{"for_s": 12}]), "kf") == ""


@pytest.mark.slow
def test_of_tracks_it_is_the_kind_of_event_that_costs_most() -> None:
    result = tb.run(tb.load("traffic/side_by_side", runs=3), workers=1)
    name = result.summary.ranking[-1]
    said = condition_of(result, name)
    assert said.endswith("of the cost of all events")
    assert " s, " in event_of(result, name)


def test_of_a_function_it_is_what_it_did_on_the_tracks() -> None:
    result = tb.run(tb.load("functions/euro_ncap_braking", runs=5), workers=1)
    (metric, name) = "warn_delay.fcw", "ekf_cv"
    chosen = "tracker == 'ekf_cv' and run == 0 and function == 'fcw'"
    (event,) = result.to_pandas("function_events").query(chosen).itertuples()
    late = "late" if event.delay_s > 0 else "early"
    text = f"fcw {late} at lead at {event.time_s:.2f} s, by {abs(event.delay_s):.2f} s" if event.delay_s else ""
    first, *errors = event_of(result, name, metric).split(", with ")
    assert first == text
    if text:
        (estimate,) = (
            found
            for found in scene_at(result, load_recorded_run(result), event.time_s).estimates
            if (found.tracker, found.object) == (name, "lead")
        )
        position, velocity = estimate.position_error_m, estimate.velocity_error_mps
        assert errors == [f"a position error of {position:.2f} m and a velocity error of {velocity:.2f} m/s then"]
    assert condition_of(result, name, metric) == ""
