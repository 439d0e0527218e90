"""How an examination is asked for and ends: by ``tb.doctor``, by ``trackbench doctor``, and for other subjects."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

import trackbench as tb
from trackbench.subjects.doctor.api import remark
from trackbench.subjects.doctor.drives import drive_configs

#: Those that take long.
SKIPPED = tuple(name for name in drive_configs() if name != "azimuth_crossing")
MODULE = """\
class Doubled:
    def __init__(self, factor=2.0):
        from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
        self.inner, self.factor = PlainEkf(), factor

    def step(self, state, scan):
        print("loud")
        state, estimate = self.inner.step(state, scan._replace(noise_covariance=self.factor * scan.noise_covariance))
        return state, estimate


class Raises:
    def step(self, state, scan):
        raise KeyError("rho")
"""


@pytest.fixture(scope="module")
def trackers(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("trackers")
    (folder / "doubled_noise.py").write_text(MODULE, encoding="utf-8")
    return str(folder)


@pytest.fixture
def importable(trackers: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(trackers)


@pytest.mark.usefixtures("importable")
def test_a_fault_is_named_shown_and_saved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told: list[tuple[int, int]] = []
    found = tb.doctor(
        "doubled_noise:Doubled",
        options={"factor": 16.0},
        skip=SKIPPED,
        in_process=True,
        out=tmp_path / "out",
        progress=lambda done, total: told.append((done, total)),
    )
    assert isinstance(found, tb.Examination)
    assert not found.healthy
    assert {(finding.fault, finding.sensor) for finding in found.findings} == {
        ("r_too_large", None),
    }
    assert "the measurement noise is too large" in str(found)
    assert found._repr_html_().startswith("<iframe srcdoc=")
    assert [run.drive for run in found.evidence] == ["azimuth_crossing"]
    assert capsys.readouterr().out == ""
    assert told[0][1] > 0
    files = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert {"examination.json", "report.html"} <= set(files) == set(found.save(tmp_path / "again"))
    assert json.loads((tmp_path / "out" / "examination.json").read_text()) == found.json()


FILES = ["examination.json", "recording.rrd", "report.html"]

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


class Ends(Good):
    def step(self, state, scan):
        if scan.time > -1 and scan.kind == "radar":
            import os

            os._exit(5)
        return super().step(state, scan)


class Silent(Good):
    def step(self, state, scan):
        return state, None
"""


@pytest.fixture
def module(tmp_path: Path, write_module: Callable[[Path, str], str]) -> str:
    return write_module(tmp_path, BROKEN)


@pytest.mark.slow
def test_a_healthy_tracker_ends_with_0(cli: Callable[..., Any], tmp_path: Path) -> None:
    done = cli("doctor", "ekf", "--option", "motion=cv", "--option", "acceleration_sigma_mps2=3")
    assert (done.status, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0] == "ekf: healthy"
    assert lines[-1] == "results/doctor/ekf/: examination.json, report.html, recording.rrd"
    assert json.loads((tmp_path / "results/doctor/ekf/examination.json").read_text())["findings"] == []
    assert "no fault found" in (tmp_path / "results/doctor/ekf/report.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Silent", "it gave no estimate at any scan"),
        (
            "Raises",
            "KeyError: 'rho' (MODULE.py:16, in step, at -3 s of ahead_left, at a measurement of lidar: lidar measures "
            "x 30, y -14)",
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
    printed, last = done.stderr.splitlines()
    assert last == expected
    assert printed == "the tracker printed a line: loud"
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "fault", "said"),
    [
        ("RadarRaises", "exception_raised", "KeyError: 'rho' (MODULE.py:22, in step, at 0 s of azimuth_crossing, at a"),
        ("Ends", "process_ended", "its process ended itself, with status 5 (MODULE.py:31, in step, at -0.95 s of"),
    ],
)
def test_a_step_that_fails_is_a_finding(
    trackbench: str, tmp_path: Path, module: str, name: str, fault: str, said: str
) -> None:
    command = [trackbench, "doctor", f"{module}:{name}", "--json", "--out", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    # A process that has ended is asked once more from here.
    printed = "2 lines; the first" if name == "Ends" else "a line"
    assert (done.returncode, done.stderr) == (1, f"the tracker printed {printed}: loud\n")
    found = {one["fault"]: one for one in json.loads(done.stdout)["findings"]}
    assert found[fault]["evidence"].startswith(said.replace("MODULE", module))
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) in (FILES, FILES[::2])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["tiny.yaml"], "tiny.yaml: name the tracker in it: tiny.yaml#raw or tiny.yaml#ekf"),
        (["tiny.yaml#ekg"], "tiny.yaml: there is no tracker 'ekg' in it: did you mean 'ekf'?"),
        (["tiny.yaml#ekf", "--option", "a=1"], "tiny.yaml: --option goes with a class"),
        (["none.yaml#ekf"], "none.yaml: there is no such file"),
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
        (["MODULE:Good", "--out", "tiny.yaml/out"], "--out: cannot write to tiny.yaml: it is a file, not a folder"),
        (["MODULE:Good", "--out", "/proc/doctor/x"], "--out: cannot write to /proc/doctor"),
        (["MODULE:Good", "--out", "."], ".: it exists and is not a folder with examination.json"),
    ],
)
def test_bad_input_is_one_line_and_2(
    cli: Callable[..., Any], tiny: Path, module: str, arguments: Sequence[str], said: str
) -> None:
    done = cli("doctor", *(argument.replace("MODULE", module) for argument in arguments))
    assert (done.status, done.out) == (2, "")
    assert done.err.splitlines()[-1].startswith(said.replace("MODULE", module))
    assert len([line for line in done.err.splitlines() if not line.startswith("the tracker printed")]) == 1
    assert not Path("results").exists() or not list(Path("results").rglob("*.*"))


@pytest.mark.slow
def test_nothing_is_said_of_a_healthy_tracker() -> None:
    assert remark(tb.load("highway"), "ekf_cv") is None


@pytest.mark.slow
def test_a_process_noise_that_is_far_too_small_is_named_with_its_evidence() -> None:
    said = remark(tb.load("highway", {"trackers.ekf_cv.acceleration_sigma_mps2": 0.01}), "ekf_cv")
    assert said is not None
    assert said.startswith("ekf_cv: ")
    assert "q_too_small" in said


def test_nothing_is_said_of_what_cannot_be_examined() -> None:
    loaded = tb.load("highway", {"trackers.ekf_cv.smoother": "rts"})
    assert remark(loaded, "ekf_cv") is None
