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
from trackbench.document.drawing import svg_in_page
from trackbench.subjects.doctor.checks.gain import gain
from trackbench.subjects.doctor.exhibit_figures import exhibit_figure, outline
from trackbench.subjects.doctor.exhibits import (
    STATE,
    Exhibit,
    Matrices,
    StatedBelief,
    points_shown,
    predicted,
)
from trackbench.subjects.doctor.findings import known_faults

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


BEFORE = StatedBelief("before", np.array([10.0, 5.0, 4.0, 2.0]), np.diag([0.04, 0.04, 1.0, 1.0]))


def drawn(exhibit: Exhibit) -> ElementTree.Element:
    return ElementTree.fromstring(svg_in_page(exhibit_figure("finding-1", exhibit)))


def test_an_ellipse_has_the_mahalanobis_distance_of_95_percent() -> None:
    mean, covariance = np.array([3.0, -2.0]), np.array([[2.0, 0.7], [0.7, 1.0]])
    apart = outline(mean, covariance) - mean[:, None]
    squares = np.einsum("ik,ij,jk->k", apart, np.linalg.inv(covariance), apart)
    # -2 ln 0.05, the 95 % point of chi-square with 2 degrees of freedom.
    assert squares == pytest.approx(np.full(squares.size, -2.0 * np.log(0.05)))
    assert outline(mean, np.diag([1.0, -0.1])).shape == (2, 0)


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
