"""Counter-examples: the run that shows one, its repetition, its cause and its folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.subjects.envelope.conftest import Commanded

import trackbench as tb
from trackbench.document import Code, Figure, Paragraph, Row, Section
from trackbench.subjects.envelope.api import FinishedEnvelope
from trackbench.subjects.envelope.claim import Envelope, read_envelope
from trackbench.subjects.envelope.counter_page import counter_sections
from trackbench.subjects.envelope.report import envelope_document


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


def test_its_value_is_that_of_the_cell_and_other_seeds_give_another(countered: Envelope) -> None:
    found = countered.claim.counter_examples
    assert found is not None
    (example,) = found.examples
    tracker = countered.shown[example.folder].result["kf"]
    assert tracker.position_rmse.value == pytest.approx(example.value, rel=1e-12)
    assert example.again.seed == 2
    # It is near the border: other seeds may not show it.
    assert example.again.state in ("fails", "undecided")
    changes = {"sensors.lidar.position_sigma_m": countered.claim.cells[example.cell].at[0], "monte_carlo.seed": 2}
    # It may have been decided at any look.
    each = [tb.run(tb.load(countered.claim.text, changes, runs=runs), workers=1) for _, runs in countered.claim.extents]
    assert pytest.approx(example.again.value, rel=1e-12) in [again["kf"].position_rmse.value for again in each]


def test_runs_beyond_the_limit_in_cells_that_hold_are_listed_furthest_first(countered: Envelope) -> None:
    found = countered.claim.counter_examples
    assert found is not None
    rows = found.beyond
    assert 0 < len(rows) <= 20
    assert rows == sorted(rows, key=lambda row: -row.value)
    for row in rows[:2]:
        cell = countered.claim.cells[row.cell]
        assert cell.trackers["kf"].state == "holds"
        (change,) = cell.changes
        loaded = tb.load(countered.claim.text, [change], runs=row.run + 1)
        runs = tb.run(loaded, workers=1).to_pandas("runs").query("tracker == 'kf'")
        assert runs["position_rmse_m"].iloc[row.run] == pytest.approx(row.value, rel=1e-12)


def test_its_folder_is_a_run_and_its_scenario_repeats_it(countered: Envelope, tmp_path: Path) -> None:
    folder = FinishedEnvelope(countered).save(tmp_path)
    (place,) = (folder / "counter_examples").iterdir()
    example = countered.shown[place.name]
    assert {"scenario.yaml", "report.html", "report.md", "recording.rrd", "result.json"} <= {
        file.name for file in place.iterdir()
    }
    assert tb.Result.load(place)["kf"].position_rmse.value == example.result["kf"].position_rmse.value
    again = tb.run(tb.load(place / "scenario.yaml", trackers=["kf"]), workers=1)
    assert again["kf"].position_rmse.value == example.result["kf"].position_rmse.value
    assert read_envelope(folder).claim == countered.claim


def test_without_recordings_there_are_none(countered: Envelope, tmp_path: Path) -> None:
    folder = FinishedEnvelope(countered).save(tmp_path, recording=False)
    assert not [*folder.rglob("*.rrd")]
    assert [*folder.rglob("report.html")]


def test_the_page_names_cause_repetition_and_runs(countered: Envelope) -> None:
    nearest, beyond = counter_sections(countered.claim)
    text = str(nearest)
    assert "not shown to fail again" in text
    assert "the doctor" in text
    assert "position error" in text
    assert "limit" in str(beyond)


def test_the_page_begins_with_the_map_beside_the_nearest_one_and_its_command(countered: Envelope) -> None:
    _, claim, first, *_ = envelope_document(countered).blocks
    assert isinstance(claim, Paragraph)
    assert isinstance(first, Row)
    figure, nearest = first.blocks
    assert isinstance(figure, Figure)
    assert isinstance(nearest, Section)
    assert countered.claim.counter_examples is not None
    (example,) = countered.claim.counter_examples.examples
    assert nearest.blocks[-1] == Code(f"trackbench view counter_examples/{example.folder}", "sh")


def test_none_are_made_where_none_are_wanted(searched: FinishedEnvelope) -> None:
    assert searched.claim.counter_examples is not None
    assert searched.claim.counter_examples.examples == []
    assert searched.envelope.shown == {}
