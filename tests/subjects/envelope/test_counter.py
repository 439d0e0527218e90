"""Counter-examples: the nearest cells that fail, the run that shows one, its cause and its folder."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.subjects.envelope.conftest import Commanded
from tests.support.claims import claim_of

import trackbench as tb
from trackbench.subjects.envelope.api import FinishedEnvelope
from trackbench.subjects.envelope.axes import point_distance
from trackbench.subjects.envelope.claim import Envelope, read_envelope
from trackbench.subjects.envelope.counter import base_of, nearest_failing
from trackbench.subjects.envelope.counter_page import event_of

#: Eleven values of each, a tenth of the range apart.
SQUARE: dict[str, Any] = {
    "q": {"key": "sensors.radar.range_sigma_m", "from": 0, "to": 10, "levels": 11},
    "r": {"key": "sensors.radar.azimuth_sigma_deg", "from": 0, "to": 1, "levels": 11},
}


def faces(axes: dict[str, Any], value: Any, **more: Any) -> dict[str, Any]:
    """By face, the point that fails."""
    claim = claim_of(axes, {"ekf": value}, **more)
    return {
        f"{facing.axis} {facing.side}": claim.cells[facing.cell].at
        for facing in nearest_failing(claim, base_of(claim, "ekf"))
    }


def test_the_border_is_met_along_each_axis_from_the_scenario() -> None:
    # Fails with q from 8 on, with r from .9 on and with r up to .1.
    found = faces(SQUARE, lambda q, r: 2.0 if q > 0.75 or abs(r - 0.5) > 0.35 else 0.5, base=[5, 0.5])
    assert found == {"q high": (8, 0.5), "r high": (5, 0.9), "r low": (5, 0.1)}


def test_a_cell_that_fails_for_another_axis_is_no_counter_example_of_this_one() -> None:
    # At q 8 everything fails, also far from r .5: that is not for r.
    assert faces(SQUARE, lambda q, r: 2.0 if q > 0.75 else 0.5, base=[5, 0.5]) == {"q high": (8, 0.5)}


def test_a_failure_that_needs_both_axes_lies_towards_the_face_of_the_further_one() -> None:
    found = faces(SQUARE, lambda q, r: 2.0 if q > 0.65 and r > 0.85 else 0.5, base=[5, 0.5])
    assert found == {"r high": (7, 0.9)}


def test_each_other_choice_is_a_face() -> None:
    axes = {"kind": {"key": "sensors.radar.type", "choices": ["radar", "lidar", "sonar"]}, "q": SQUARE["q"]}
    found = faces(axes, lambda kind, q: 2.0 if kind > 0.75 and q > 0.45 else 0.5, base=["radar", 5])
    assert found == {"kind sonar": ("sonar", 5)}


def test_a_scenario_that_fails_counts_from_the_nearest_cell_that_holds() -> None:
    claim = claim_of(SQUARE, {"ekf": lambda q, r: 2.0 if q > 0.45 else 0.5}, base=[6, 0.5])
    base = base_of(claim, "ekf")
    assert base.at == (4, 0.5)
    assert base.note.startswith("the scenario fails")
    assert faces(SQUARE, lambda q, r: 2.0 if q > 0.45 else 0.5, base=[6, 0.5]) == {"q high": (5, 0.5)}


def test_an_axis_without_a_value_of_the_scenario_takes_its_middle() -> None:
    base = base_of(claim_of(SQUARE, {"ekf": lambda q, r: 0.5}, base=[None, 0.2]), "ekf")
    assert base.at == (5, 0.2)


@given(st.sets(st.tuples(st.integers(0, 10), st.integers(0, 10)), max_size=30))
def test_the_nearest_of_all_cells_that_fail_is_always_found(failing: set[tuple[int, int]]) -> None:
    claim = claim_of(
        SQUARE,
        {"ekf": lambda q, r: 2.0 if (round(10 * q), round(10 * r)) in failing - {(5, 5)} else 0.5},
        base=[5, 0.5],
    )
    found = nearest_failing(claim, base_of(claim, "ekf"))
    ways = [
        point_distance(claim.axes, (5, 0.5), cell.at) for cell in claim.cells if cell.trackers["ekf"].state == "fails"
    ]
    assert min((facing.distance for facing in found), default=math.inf) == min(ways, default=math.inf)
    assert all(claim.cells[facing.cell].trackers["ekf"].state == "fails" for facing in found)
    assert len({(facing.axis, facing.side) for facing in found}) == len(found) <= 4


@pytest.fixture(scope="module")
def countered(commanded: Commanded) -> Envelope:
    return commanded.envelope


def test_the_only_face_that_fails_has_the_nearest_cell(countered: Envelope) -> None:
    found = countered.claim.counter_examples
    assert found is not None
    (example,) = found.examples
    assert (example.tracker, example.axis, example.side) == ("kf", "sigma", "high")
    failing = [cell.at[0] for cell in countered.claim.cells if cell.trackers["kf"].state == "fails"]
    assert countered.claim.cells[example.cell].at == (min(failing),)


def test_it_is_shown_by_the_median_of_the_failing_runs_which_is_the_one_that_is_recorded(countered: Envelope) -> None:
    found = countered.claim.counter_examples
    assert found is not None
    (example,) = found.examples
    result = countered.shown[example.folder].result
    values = result.to_pandas("runs").query("tracker == 'kf'").set_index("run")["position_rmse_m"]
    failing = values[values >= 0.25]
    assert (example.shown.beyond, example.shown.runs) == (len(failing), len(values))
    assert values[example.shown.run] == pytest.approx(example.shown.value, rel=1e-12)
    below, above = (failing < example.shown.value).sum(), (failing > example.shown.value).sum()
    assert above - below in (0, 1)
    assert result.summary.recorded_run == example.shown.run
    # The estimates of that run are in the result.
    recorded = result.to_pandas("estimates").query("tracker == 'kf' and due == 1")["position_error_m"]
    assert np.sqrt((recorded**2).mean()) == pytest.approx(example.shown.value, rel=1e-9)


def test_its_folder_is_a_run_and_its_scenario_repeats_it(countered: Envelope, tmp_path: Path) -> None:
    folder = FinishedEnvelope(countered).save(tmp_path)
    (place,) = (folder / "counter_examples").iterdir()
    example = countered.shown[place.name]
    assert {"scenario.yaml", "report.html", "report.md", "recording.rrd", "result.json"} <= {
        file.name for file in place.iterdir()
    }
    assert f"trackbench view counter_examples/{place.name}" in (folder / "envelope.md").read_text()
    assert tb.Result.load(place)["kf"].position_rmse.value == example.result["kf"].position_rmse.value
    again = tb.run(tb.load(place / "scenario.yaml", trackers=["kf"]), workers=1)
    assert again["kf"].position_rmse.value == example.result["kf"].position_rmse.value
    assert read_envelope(folder).claim.model_copy(update={"parts": None}) == countered.claim


def test_a_recording_is_not_offered_where_there_is_none(commanded: Commanded) -> None:
    page = (commanded.folder / "results" / "small-envelope" / "envelope.md").read_text()
    for text in (page, commanded.done.output):
        assert "Nearest counter-examples" in text
        assert "has the scenario and the report of" in " ".join(text.split())
        assert "trackbench view" not in text


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


def test_the_worst_moment_is_in_the_turn() -> None:
    result = result_of([{"for_s": 5}, {"for_s": 2, "turn_rate_degps": 30}, {"for_s": 5}])
    assert event_of(result, "kf").startswith("position error ")
    time = float(event_of(result, "kf").rpartition(" at ")[2].removesuffix(" s"))
    assert 5 < time < 8.5


@pytest.mark.slow
def test_of_tracks_it_is_the_dearest_event() -> None:
    result = tb.run(tb.load("traffic/side_by_side", runs=3), workers=1)
    name = result.summary.ranking[-1]
    assert " s, " in event_of(result, name)


def test_of_a_function_it_is_what_it_did_on_the_tracks() -> None:
    result = tb.run(tb.load("functions/euro_ncap_braking", runs=5), workers=1)
    (metric, name) = "warn_delay.fcw", "ekf_cv"
    chosen = "tracker == 'ekf_cv' and run == 0 and function == 'fcw'"
    (event,) = result.to_pandas("function_events").query(chosen).itertuples()
    late = "late" if event.delay_s > 0 else "early"
    text = f"fcw {late} at lead at {event.time_s:.2f} s, by {abs(event.delay_s):.2f} s" if event.delay_s else ""
    assert event_of(result, name, metric) == text
