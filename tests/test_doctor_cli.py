"""``trackbench doctor``: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from tests.test_report import Page

from trackbench.doctor.examine import Examination
from trackbench.doctor.failures import failure_findings
from trackbench.doctor.findings import CheckResult, Finding, known_faults
from trackbench.doctor.session import StepFailed
from trackbench.report.examination.text import text
from trackbench.trackers.answers import TOO_LARGE, TrackerFault
from trackbench.types import Scan

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
FILES = ["examination.json", "recording.rrd", "report.html"]
KEYS = {"fault", "confidence", "sensor", "factor", "evidence", "advice", "consequence_of"}

BROKEN = """\
import numpy as np

print("loud")


class Good:
    def __init__(self, gain=1.0):
        self.gain = float(gain)

    def step(self, state, scan):
        return state, (np.zeros(4), np.eye(4))


class Raises(Good):
    def step(self, state, scan):
        raise KeyError("rho")


class RadarRaises(Good):
    def step(self, state, scan):
        if scan.time > -1 and scan.kind == "radar":
            raise KeyError("rho")
        return super().step(state, scan)


class Shape(Good):
    def step(self, state, scan):
        return state, (np.zeros((4, 1)), np.eye(4))


class Kind(Good):
    def step(self, state, scan):
        return "estimate"


class Missed(Good):
    def step(self, state, scan):
        if not scan.valid:
            raise ValueError("nothing to read")
        return super().step(state, scan)


class Stopped(Good):
    def step(self, state, scan):
        raise KeyboardInterrupt


class Ends(Good):
    def step(self, state, scan):
        if scan.time > -1 and scan.kind == "radar":
            import os

            os._exit(5)
        return super().step(state, scan)
"""


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


@pytest.fixture
def module(tmp_path: Path, write_module: Callable[[Path, str], str]) -> str:
    return write_module(tmp_path, BROKEN)


def test_a_fault_is_named_and_the_status_is_1(faulty: Faulty) -> None:
    assert faulty.done.returncode == 1
    said = json.loads(faulty.done.stdout)
    assert said["tracker"] == "sensor_fusion_student:Tracker"
    assert said["healthy"] is False
    first = said["findings"][0]
    assert (first["fault"], first["sensor"], first["consequence_of"]) == ("azimuth_not_wrapped", "radar", None)
    assert all(set(finding) == KEYS for finding in said["findings"])
    assert all(set(check) == {"name", "question", "passed", "skipped", "result"} for check in said["checks"])


def test_json_is_what_is_written_and_nothing_else_is_printed(faulty: Faulty) -> None:
    assert (faulty.out / "examination.json").read_text(encoding="utf-8") == faulty.done.stdout
    assert faulty.done.stderr == ""
    assert sorted(path.name for path in faulty.out.iterdir()) == FILES
    assert [path.name for path in faulty.out.parent.iterdir()] == ["out"]


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
    assert len(page.rows) == 1 + len(json.loads(faulty.done.stdout)["checks"])
    assert not re.search("https?://", markup)


def test_the_recording_shows_the_jump(faulty: Faulty) -> None:
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


def test_a_healthy_tracker_ends_with_0(cli: Callable[..., Any], tmp_path: Path) -> None:
    done = cli("doctor", "ekf", "--option", "motion=cv", "--option", "acceleration_sigma_mps2=3")
    assert (done.status, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0] == "ekf: healthy"
    assert lines[-1] == "results/doctor/ekf/: examination.json, report.html, recording.rrd"
    assert json.loads((tmp_path / "results/doctor/ekf/examination.json").read_text())["findings"] == []
    assert "no fault found" in (tmp_path / "results/doctor/ekf/report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "Raises",
            "KeyError: 'rho' (MODULE.py:16, in step, at -3 s of ahead_left, at a measurement of lidar: lidar measures "
            "x 30, y -14)",
        ),
        (
            "Shape",
            "the mean has the shape (4, 1), where (4,) is needed (at -3 s of ahead_left, at a measurement of lidar: "
            "lidar measures x 30, y -14)",
        ),
        (
            "Kind",
            "step must return (state, estimate), not str 'estimate' (at -3 s of ahead_left, at a measurement of lidar: "
            "lidar measures x 30, y -14)",
        ),
        (
            "Stopped",
            "KeyboardInterrupt (MODULE.py:45, in step, at -3 s of ahead_left, at a measurement of lidar: lidar "
            "measures x 30, y -14)",
        ),
    ],
)
def test_one_of_which_nothing_can_be_asked_ends_with_3(
    trackbench: str, tmp_path: Path, module: str, name: str, said: str
) -> None:
    """As a command of its own: what a tracker prints comes from its process, and not through Python."""
    command = [trackbench, "doctor", f"{module}:{name}", "--json", "--out", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (3, "")
    expected = f"{module}:{name} cannot be examined: {said.replace('MODULE', module)}"
    *before, last = done.stderr.splitlines()
    assert last == expected
    # It is started once more, as a tracker of several objects.
    assert set(before) == {"loud"}
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "fault", "said"),
    [
        ("RadarRaises", "exception_raised", "KeyError: 'rho' (MODULE.py:22, in step, at 0 s of azimuth_crossing, at a"),
        (
            "Missed",
            "exception_raised",
            "ValueError: nothing to read (MODULE.py:39, in step, at 0.0001 s of fast_left, at a",
        ),
        ("Ends", "process_ended", "its process ended itself, with status 5 (MODULE.py:53, in step, at -0.95 s of"),
    ],
)
def test_a_step_that_fails_is_a_finding(
    trackbench: str, tmp_path: Path, module: str, name: str, fault: str, said: str
) -> None:
    command = [trackbench, "doctor", f"{module}:{name}", "--json", "--out", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "loud\n")
    found = {one["fault"]: one for one in json.loads(done.stdout)["findings"]}
    assert found[fault]["evidence"].startswith(said.replace("MODULE", module))
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) in (FILES, FILES[::2])


def test_an_interrupt_leaves_nothing(cli: Callable[..., Any], tmp_path: Path, module: str) -> None:
    before = {path.name for path in tmp_path.iterdir()}
    done = cli("doctor", f"{module}:Stopped", "--in-process", "--out", "out")
    assert (done.status, done.out) == (130, "")
    assert {path.name for path in tmp_path.iterdir()} - before <= {"__pycache__"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["tiny.yaml"], "tiny.yaml: name the tracker in it: tiny.yaml#raw or tiny.yaml#ekf"),
        (["tiny.yaml#"], "tiny.yaml: there is no tracker '' in it: choose from: ekf, raw"),
        (["tiny.yaml#ekg"], "tiny.yaml: there is no tracker 'ekg' in it: did you mean 'ekf'?"),
        (["tiny.yaml#ekf", "--option", "a=1"], "tiny.yaml: --option goes with a class"),
        (["none.yaml#ekf"], "none.yaml: there is no such file"),
        (["no_such_module:X"], "cannot import 'no_such_module:X': no module named 'no_such_module'"),
        (["MODULE:X"], "module 'MODULE' has no 'X'"),
        (["ekff"], "no tracker is published as 'ekff': did you mean 'ekf'?"),
        (["MODULE:Good", "--option", "gain"], "--option: write KEY=VALUE, such as sigma=3, not 'gain'"),
        (["MODULE:Good", "--option", "gain=[1"], "--option gain=[1:1: not valid YAML"),
        (
            ["MODULE:Good", "--option", "gian=1"],
            "'MODULE:Good' does not start with these options: got an unexpected keyword argument 'gian'",
        ),
        (["MODULE:Good", "--skip", "gian"], "--skip: there is no check 'gian': did you mean 'gain'?"),
        (["MODULE:Good", "--identities", "hidden", "--skip", "gain"], "--skip: only for a tracker of one object"),
        (["MODULE:Good", "--identities", "hidden", "--no-misses"], "--no-misses: only for a tracker of one object"),
        (["MODULE:Good", "--scenario", "none.yaml"], "none.yaml: there is no such file"),
        (["MODULE:Good", "--out", "/proc/doctor/x"], "--out: cannot write to /proc/doctor"),
        (["MODULE:Good", "--out", "."], ".: there already, and not a folder with examination.json: not replaced"),
    ],
)
def test_bad_input_is_one_line_and_2(
    cli: Callable[..., Any], tiny: Path, module: str, arguments: Sequence[str], said: str
) -> None:
    done = cli("doctor", *(argument.replace("MODULE", module) for argument in arguments))
    assert (done.status, done.out) == (2, "")
    assert done.err.splitlines()[-1].startswith(said.replace("MODULE", module))
    assert len([line for line in done.err.splitlines() if line != "loud"]) == 1
    assert not Path("results").exists() or not list(Path("results").rglob("*.*"))


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
            CheckResult("b", "Why?", False, long),
            CheckResult("c", long, None, "could not"),
        ],
    )
    said, every = text(examination), text(examination, every_check=True)
    assert max(len(line) for line in (said + every).splitlines()) <= 80
    assert "mine: 1 fault found" in said
    assert "jacobian_wrong: confidence 90 %, sensor radar, factor 4" in said
    assert "  r_too_small (of jacobian_wrong): a sentence" in said
    assert "Checks: 1 of 2 passed, failed:\n  b: Why?\n1 check not made:\n  c: could not" in said
    assert "FAILED   b: Why?" in every


def _under_test(cause: BaseException, where: str) -> Any:
    def scan(time: float) -> Scan:
        return Scan(
            time, "radar", "radar", np.ones(3), np.array(True), np.eye(3), np.zeros(3), np.zeros(2), time
        )  # fmt: skip

    class Failing:
        def step(self, state: Any, given: Scan) -> Any:
            if given.time > 1.0:
                raise cause
            return 1, (np.ones(4), np.eye(4))

    failure = StepFailed(cause, scan(1.5), [scan(1.0)])
    drives = [(SimpleNamespace(name="long_run"), None)]
    return SimpleNamespace(failures=[(where, failure)], make=Failing, sensors={"radar": None}, drives=drives)


@pytest.mark.parametrize(
    ("cause", "where", "fault"),
    [
        (np.linalg.LinAlgError("Matrix is not positive definite"), "long_run", "covariance_not_psd"),
        (np.linalg.LinAlgError("Matrix is not positive definite"), "ahead_left", "covariance_not_psd"),
        (ZeroDivisionError("float division by zero"), "stationary", "nonfinite"),
        (ValueError("math domain error"), "on_the_sensor", "nonfinite"),
        (OverflowError("too large"), "ahead_left", "nonfinite"),
        (IndexError("history"), "long_run", "exception_raised"),
        (AssertionError("gate"), "ahead_left", "exception_raised"),
        (TrackerFault("the mean has the shape (3,)"), "long_run", "invalid_estimate"),
        (TrackerFault(TOO_LARGE), "long_run", "too_far_off"),
        (TrackerFault(TOO_LARGE), "ahead_left", "invalid_estimate"),
    ],
)
def test_every_error_is_a_finding(cause: BaseException, where: str, fault: str) -> None:
    (finding,) = failure_findings(_under_test(cause, where))
    assert (finding.fault, finding.shown_by, finding.confidence) == (fault, where, 0.97)
    assert str(cause) in finding.evidence
    assert f"at 1.5 s of {where}, at a measurement of radar: radar measures range 1, azimuth 1" in finding.evidence
    assert "a missed measurement at that time breaks it too" in finding.evidence
    assert "the smallest eigenvalue of the covariance is 1 after the scan before, at 1 s" in finding.evidence
