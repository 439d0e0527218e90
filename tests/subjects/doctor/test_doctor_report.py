"""What ``trackbench doctor`` prints and writes of a fault; the figure of a finding shows the numbers that it names."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.report.test_report import Page
from tests.support.places import DOCS

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
    assert {label.split()[0] for label in drawn} == {"Innovations", "Map"}
    # Those that failed and those that passed have a table each.
    made = [check for check in json.loads(faulty.done.stdout)["checks"] if check["passed"] is not None]
    assert len(page.rows) == 2 + len(made)
    assert not re.search("https?://", markup)
