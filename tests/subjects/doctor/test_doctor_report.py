"""What ``trackbench doctor`` prints and writes of a fault; the figure of a finding shows the numbers that it names."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.report.test_report import Page
from tests.support.doctor import Part, mutant, mutant_under_test
from tests.support.places import DOCS

from trackbench.base.types import Estimate
from trackbench.document import Paragraph, Section
from trackbench.document.drawing import svg_in_page
from trackbench.subjects.doctor.checks.covariance_update import covariance_update
from trackbench.subjects.doctor.checks.expectation import expectation
from trackbench.subjects.doctor.checks.gain import gain
from trackbench.subjects.doctor.checks.prediction import motion_prediction
from trackbench.subjects.doctor.exhibit_figures import exhibit_figure, outline
from trackbench.subjects.doctor.exhibits import (
    STATE,
    Course,
    Covariances,
    Exhibit,
    Matrices,
    OverTime,
    Panel,
    Points,
    Predictions,
    Ring,
    StatedBelief,
    points_shown,
    predicted,
)
from trackbench.subjects.doctor.findings import CheckResult, Finding, known_faults
from trackbench.subjects.doctor.output_checks import FaultyStep, asymmetry_shown, indefinite_shown
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.report import Examination, examination_document, examination_text
from trackbench.subjects.doctor.subject import SENSORS

EXAMPLES = DOCS / "examples"
FILES = ["examination.json", "recording.rrd", "report.html"]
KEYS = {"fault", "confidence", "explains", "sensor", "factor", "evidence", "advice", "consequence_of", "shown_by"}


@dataclass(frozen=True)
class Faulty:
    """The student's tracker, examined."""

    done: subprocess.CompletedProcess[str]
    out: Path


@pytest.fixture(scope="module")
def faulty(trackbench: str, tmp_path_factory: pytest.TempPathFactory) -> Faulty:
    out = tmp_path_factory.mktemp("doctor") / "out"
    command = [trackbench, "doctor", "sensor_fusion_student:Tracker", "--json", "--out", str(out)]
    return Faulty(subprocess.run(command, cwd=EXAMPLES, capture_output=True, text=True, check=False), out)


@pytest.mark.slow
def test_a_fault_is_named_and_the_status_is_1(faulty: Faulty) -> None:
    assert faulty.done.returncode == 1
    said = json.loads(faulty.done.stdout)
    assert said["tracker"] == "sensor_fusion_student:Tracker"
    assert said["healthy"] is False
    first = said["findings"][0]
    assert (first["fault"], first["sensor"], first["consequence_of"]) == ("azimuth_not_wrapped", "radar", None)
    assert all(set(finding) == KEYS for finding in said["findings"])
    assert all(set(check) == {"name", "question", "passed", "skipped", "result", "faults"} for check in said["checks"])


@pytest.mark.slow
def test_json_is_what_is_written_and_nothing_else_is_printed(faulty: Faulty) -> None:
    assert (faulty.out / "examination.json").read_text(encoding="utf-8") == faulty.done.stdout
    assert faulty.done.stderr == ""
    assert sorted(path.name for path in faulty.out.iterdir()) == FILES
    assert [path.name for path in faulty.out.parent.iterdir()] == ["out"]


@pytest.mark.slow
def test_the_report_shows_the_jump(faulty: Faulty) -> None:
    markup = (faulty.out / "report.html").read_text(encoding="utf-8")
    page = Page(markup)
    finding = json.loads(faulty.done.stdout)["findings"][0]
    assert finding["evidence"] in page.text
    assert known_faults()["azimuth_not_wrapped"].fix in page.text
    drawn = {str(plot.get("aria-label")) for plot in page.all("svg")}
    (innovation,) = (label for label in drawn if label.startswith("Innovations of radar over time, azimuth"))
    assert "azimuth applied -6.2" in innovation
    assert {label.split()[0] for label in drawn} == {"Innovations", "Map", "Position", "NEES", "Update"}
    (update,) = (label for label in drawn if label.startswith("Update with radar: a target just before the azimuth pi"))
    assert re.search(r"Position: tracker .*; as of the same target turned away .* m apart", update)
    # Those that failed and those that passed have a table each.
    made = [check for check in json.loads(faulty.done.stdout)["checks"] if check["passed"] is not None]
    assert len(page.rows) == 2 + len(made)
    assert not re.search("https?://", markup)


@pytest.mark.slow
def test_the_recording_shows_the_jump(faulty: Faulty) -> None:
    from rerun.chunk import RrdReader

    reader = RrdReader(faulty.out / "recording.rrd")
    (store,) = reader.recordings()
    chunks = [chunk.to_record_batch() for chunk in reader.stream(store=store)]
    names = {name for chunk in chunks for name in chunk.schema.names}
    assert "sim_time" in names
    by_entity: dict[str, list[float]] = {}
    texts = []
    for chunk in chunks:
        entity = chunk.schema.metadata[b"rerun:entity_path"].decode()
        for name, values in zip(chunk.schema.names, chunk.columns, strict=True):
            if name == "Scalars:scalars":
                by_entity.setdefault(entity, []).extend(v for row in values.to_pylist() for v in row or [])
            if name == "TextDocument:text":
                texts += [line for row in values.to_pylist() for line in row or []]
    applied, expected = (
        np.array(by_entity[f"/series/azimuth_crossing/innovation/radar/azimuth/{name}"])
        for name in ("tracker", "reference")
    )
    first = int(np.argmax(np.abs(applied - expected) > 1.0))
    assert applied[first] == pytest.approx(-2 * np.pi, abs=0.1)
    assert expected[first] == pytest.approx(0.0, abs=0.1)
    entities = {chunk.schema.metadata[b"rerun:entity_path"].decode() for chunk in chunks}
    scene = {
        "truth",
        "sensors",
        "tracker",
        "tracker/covariance",
        "reference",
        "measurements/radar",
        "measurements/lidar",
    }
    assert {f"/azimuth_crossing/world/{name}" for name in scene} <= entities
    assert "azimuth_not_wrapped" in "".join(texts)
    assert len(reader.blueprints()) == 1


@pytest.mark.slow
def test_the_text_fits_80_columns_and_tells_roots_from_consequences() -> None:
    long = "a sentence of evidence with 12.5 numbers " * 8
    examination = Examination(
        "mine",
        [
            Finding("jacobian_wrong", 0.9, long, sensor="radar", factor=4.0),
            Finding("r_too_small", 0.6, long, consequence_of="jacobian_wrong"),
        ],
        [
            CheckResult("a", long, True, long),
            CheckResult("b", "Why?", False, long, faults=("r_too_small",)),
            CheckResult("c", long, None, "could not"),
        ],
    )
    said, every = examination_text(examination), examination_text(examination, every_check=True)
    assert max(len(line) for line in (said + every).splitlines()) <= 80
    assert "mine: 1 fault found" in said
    assert "jacobian_wrong: likely, explains 1 failed check, sensor radar, factor 4" in said
    assert "  r_too_small (of jacobian_wrong): a sentence" in said
    assert "Checks: 1 of 2 passed, failed:\n  b: Why?\n1 check not made:\n  c: could not" in said
    assert "FAILED   b: Why?" in every
    answer, _, _, *sections = examination_document(examination).blocks
    assert answer == Paragraph(f"mine: 1 fault found: {known_faults()['jacobian_wrong'].title}", strong=True)
    titles = [(block.title, block.folded) for block in sections if isinstance(block, Section)]
    assert titles[0][0].startswith("1. ")
    failed, not_made, passed = titles[-3:]
    assert (failed, passed) == (("Checks that failed", False), ("Checks that passed", True))
    assert not_made[0] == "Not made"


BEFORE = StatedBelief("before", np.array([10.0, 5.0, 4.0, 2.0]), np.diag([0.04, 0.04, 1.0, 1.0]))
TRACKER = StatedBelief("tracker", np.array([10.0, 5.0, 4.0, 2.0]), np.diag([0.04, 0.04, 1.0, 1.0]))
RIGHT = StatedBelief("right", np.array([14.0, 7.0, 4.0, 2.0]), np.diag([1.0, 1.0, 1.0, 1.0]))
TIME = np.linspace(0.0, 10.0, 101)

EXHIBITS: dict[str, tuple[Exhibit, set[str]]] = {
    "matrices": (
        Matrices(
            "A", ("a, m",), STATE, (Panel("t", np.ones((1, 4))), Panel("r", np.zeros((1, 4)), "right")), ((0, 2),)
        ),
        {"marked-0-0-2", "marked-1-0-2"},
    ),
    "predictions": (Predictions("A", BEFORE, TRACKER, RIGHT), {"shown-before", "shown-tracker", "shown-right"}),
    "covariances": (Covariances("A", BEFORE, TRACKER, RIGHT), {"shown-before", "shown-tracker", "shown-right"}),
    "over time": (
        OverTime("A", "time, s", TIME, (Course("error, m", TIME + 1.0, TIME / 2 + 1.0),), (5.0, 6.0)),
        {"shown-tracker", "shown-right", "marked"},
    ),
    "points": (
        Points(
            "A",
            ("px, m", "py, m"),
            "tracker",
            np.array([[1.0, -1.0], [0.0, 0.0]]),
            None,
            Ring("ring", np.zeros(2), np.eye(2), 2.0),
            np.array([[2.0, -2.0], [0.0, 0.0]]),
            "right",
        ),
        {"shown-tracker", "shown-right"},
    ),
}


def drawn(exhibit: Exhibit) -> ElementTree.Element:
    return ElementTree.fromstring(svg_in_page(exhibit_figure("finding-1", exhibit)))


@pytest.mark.parametrize("kind", EXHIBITS)
def test_what_is_wrong_and_what_is_right_are_both_drawn(kind: str) -> None:
    exhibit, parts = EXHIBITS[kind]
    assert {element.get("class") for element in drawn(exhibit).iter()} >= parts


def test_a_matrix_is_drawn_with_its_numbers_names_and_units() -> None:
    panels = (Panel("implied", np.array([[0.5, -0.25, 1e-17, 0.0]])), Panel("right", np.full((1, 4), 0.125), "right"))
    svg = drawn(Matrices("Jacobian", ("azimuth, rad",), STATE, panels, ((0, 1),)))
    said = [text.text for text in svg.iter("text")]
    assert said.count("azimuth, rad") == 1
    counts = {"px, m": 2, "vy, m/s": 2, "0.5": 1, "\N{MINUS SIGN}0.25": 1, "0": 2, "0.125": 4}
    assert {one: said.count(one) for one in counts} == counts
    titles = [title.text for title in svg.iter("title")]
    assert titles == ["row azimuth, rad, column py, m: implied -0.25", "row azimuth, rad, column py, m: right 0.125"]


def test_matrices_without_room_beside_each_other_stand_below() -> None:
    wide, narrow = np.full((4, 4), -1.234e-5), np.ones((4, 4))
    heights = [
        exhibit_figure("a", Matrices("A", STATE, STATE, (Panel("a", values), Panel("b", values)), ())).height
        for values in (wide, narrow)
    ]
    assert heights[0] > 1.8 * heights[1]


def test_only_the_planes_that_differ_are_drawn() -> None:
    assert (
        "Position: tracker 10, 5 m; right 14, 7 m: 4.47 m apart."
        in exhibit_figure("a", EXHIBITS["predictions"][0]).caption
    )
    svg = drawn(EXHIBITS["predictions"][0])
    assert "vx, m/s" not in [text.text for text in svg.iter("text")]
    slower = RIGHT._replace(mean=np.array([14.0, 7.0, 3.0, 2.0]))
    svg = drawn(Predictions("A", None, slower, RIGHT))
    said = [text.text for text in svg.iter("text")]
    assert ("vx, m/s" in said, "px, m" in said) == (True, False)


def test_an_ellipse_has_the_mahalanobis_distance_of_95_percent() -> None:
    mean, covariance = np.array([3.0, -2.0]), np.array([[2.0, 0.7], [0.7, 1.0]])
    apart = outline(mean, covariance) - mean[:, None]
    squares = np.einsum("ik,ij,jk->k", apart, np.linalg.inv(covariance), apart)
    # -2 ln 0.05, the 95 % point of chi-square with 2 degrees of freedom.
    assert squares == pytest.approx(np.full(squares.size, -2.0 * np.log(0.05)))
    assert outline(mean, np.diag([1.0, -0.1])).shape == (2, 0)


def test_the_caption_over_time_gives_the_means_of_the_marked_interval() -> None:
    exhibit = OverTime(
        "A", "time, s", TIME, (Course("error, m", np.where(TIME >= 5.0, 8.0, 1.0), np.full(101, 0.5)),), (5.0, 6.0)
    )
    assert exhibit_figure("a", exhibit).caption == "Error, m: mean from 5 to 6 s tracker 8, reference 0.5."


def test_the_right_prediction_is_that_of_white_accelerations() -> None:
    after = predicted(Estimate(BEFORE.mean, BEFORE.covariance), 0.5)
    assert after.mean == pytest.approx([12.0, 6.0, 4.0, 2.0])
    # P_px = 0.04 + t^2 1 + (t^2 / 2)^2 3^2, P_px,vx = t 1 + t^3 / 2 3^2, P_vx = 1 + t^2 3^2
    assert after.covariance[0, [0, 2]] == pytest.approx([0.04 + 0.25 + 0.140625, 0.5 + 0.5625])
    assert after.covariance[2, 2] == pytest.approx(1.0 + 2.25)


def test_sigma_points_have_the_covariances_that_are_drawn() -> None:
    p = np.array([[0.5, 0.1, 0.2, 0.0], [0.1, 0.4, 0.0, 0.1], [0.2, 0.0, 2.0, 0.0], [0.0, 0.1, 0.0, 1.0]])
    before, after = Estimate(np.arange(4.0), p), Estimate(np.arange(4.0), 0.6 * p)
    shown = points_shown(before, after)
    assert shown.right is not None
    for points, factor in ((shown.right, 1.0), (shown.tracker, 0.6)):
        assert np.cov(points, bias=True) == pytest.approx(factor * p[:2, :2])
    assert points_shown(before, after, weights=1.1).weight == pytest.approx((1.1 / 8, 1 / 8))


def test_the_entries_of_a_covariance_that_are_named_are_marked() -> None:
    radar_scan = GENERAL[0].scan("radar", SENSORS["radar"], 0.0)
    before, after = np.eye(4), np.eye(4)
    after[0, 2] = 0.3
    shown = asymmetry_shown(FaultyStep("update", radar_scan, before, after))
    assert set(shown.marked) == {(0, 2), (2, 0)}
    assert [panel.role for panel in shown.panels] == ["before", "tracker", "tracker"]
    assert shown.panels[2].values[0, 2] == pytest.approx(0.3)
    after = np.diag([1.0, -0.2, 1.0, 1.0])
    assert indefinite_shown(FaultyStep("prediction", radar_scan, before, after)).marked == ((1, 1),)
    after = np.eye(4)
    after[1, 3] = after[3, 1] = 1.5
    assert set(indefinite_shown(FaultyStep("prediction", radar_scan, before, after)).marked) == {(1, 3), (3, 1)}


def exhibit_of(part: Part, name: str) -> Any:
    """That of the first finding of an injected fault."""
    found = part(mutant_under_test(name)).findings[0]
    assert found.fault == mutant(name).fault
    return found.exhibit


def test_a_wrong_entry_of_the_jacobian_is_marked_beside_the_right_one() -> None:
    shown = exhibit_of(gain, "jacobian_wrong/plain_ekf/azimuth_sign")
    assert isinstance(shown, Matrices)
    assert (shown.rows[1], shown.columns) == ("azimuth, rad", STATE)
    implied, right = (panel.values for panel in shown.panels)
    ((i, j),) = shown.marked
    assert i == 1
    assert implied[i, j] == pytest.approx(-right[i, j], rel=1e-3)
    assert implied[[0, 2]] == pytest.approx(right[[0, 2]], abs=1e-3)


def test_a_prediction_that_is_not_made_is_drawn_at_the_state_before() -> None:
    shown = exhibit_of(motion_prediction, "missed_scan_not_predicted/plain_ekf/skipped")
    assert isinstance(shown, Predictions)
    assert shown.before is not None
    assert shown.tracker.mean == pytest.approx(shown.before.mean)
    assert shown.right.mean[:2] == pytest.approx(shown.before.mean[:2] + 1.0 * shown.before.mean[2:])


def test_a_covariance_that_is_not_reduced_is_drawn_as_it_was_before() -> None:
    shown = exhibit_of(covariance_update, "covariance_not_reduced/plain_ekf/update")
    assert isinstance(shown, Covariances)
    assert shown.right is not None
    assert shown.tracker.covariance == pytest.approx(shown.before.covariance)
    assert np.trace(shown.right.covariance) < 0.9 * np.trace(shown.before.covariance)


def test_a_measurement_that_is_predicted_wrongly_is_marked() -> None:
    shown = exhibit_of(expectation, "scale_error/plain_ekf/range_1.02")
    assert isinstance(shown, Matrices)
    used, right = (panel.values[:, 0] for panel in shown.panels)
    assert shown.marked == ((0, 0),)
    assert right[0] / used[0] == pytest.approx(1.02, rel=1e-3)


def test_of_a_long_time_what_is_around_the_marked_interval_is_drawn() -> None:
    time = np.linspace(0.0, 100.0, 1001)
    svg = drawn(OverTime("A", "time, s", time, (Course("error, m", np.full(1001, 0.5)),), (40.0, 41.0)))
    said = {text.text for text in svg.iter("text")}
    assert {"35", "40", "45"} <= said
    assert not said & {"0", "20", "60", "100"}
