"""``tb.doctor``: what the command says and writes, from Python."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import trackbench as tb
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.drives import drive_configs

#: Those that take long.
SKIPPED = tuple(name for name in drive_configs() if name != "azimuth_crossing")
MODULE = """\
class Doubled:
    def __init__(self, factor=2.0):
        from benchmarks.doctor.plain_ekf import PlainEkf
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
def module(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("trackers")
    (folder / "doubled_noise.py").write_text(MODULE, encoding="utf-8")
    return str(folder)


@pytest.fixture
def importable(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(module)


@pytest.mark.usefixtures("importable")
def test_a_fault_is_named_shown_and_saved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told: list[tuple[int, int]] = []
    found = tb.doctor(
        "doubled_noise:Doubled",
        options={"factor": 4.0},
        skip=SKIPPED,
        in_process=True,
        out=tmp_path / "out",
        progress=lambda done, total: told.append((done, total)),
    )
    assert isinstance(found, tb.Examination)
    assert not found.healthy
    assert {(one.fault, one.sensor) for one in found.findings} == {("r_too_large", "lidar"), ("r_too_large", "radar")}
    assert "the measurement noise is too large" in str(found)
    assert found._repr_html_().startswith("<iframe srcdoc=")
    assert [run.drive for run in found.evidence] == ["azimuth_crossing"]
    assert capsys.readouterr().out == ""
    assert told[0][1] > 0
    files = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert {"examination.json", "report.html"} <= set(files) == set(found.save(tmp_path / "again"))
    assert json.loads((tmp_path / "out" / "examination.json").read_text()) == found.json()


def test_a_tracker_of_several_objects_is_examined() -> None:
    found = tb.doctor("traffic/dense_highway#naive")
    assert found.findings[0].fault == "order_dependent"
    assert found.evidence == ()


@pytest.mark.parametrize(
    ("tracker", "options", "words"),
    [
        ("highway", {}, "name the tracker in it: highway#"),
        ("highway#nobody", {}, "there is no tracker 'nobody'"),
        ("highway#ekf_cv", {"options": {"sigma": 3}}, "the scenario has the options of its trackers"),
        ("highway#ekf_cv", {"skip": ["gian"]}, "skip: there is no check 'gian': did you mean 'gain'"),
        ("highway#ekf_cv", {"identities": "hidden"}, "leave --identities out"),
        ("traffic/dense_highway#naive", {"no_misses": True}, "no_misses: only for a tracker of one object"),
        ("nowhere_at_all:Tracker", {}, "nowhere_at_all"),
        ("ekf", {"options": {"motion": "cv"}, "tracker_timeout": 0.0}, "tracker_timeout"),
    ],
)
def test_bad_input_is_refused(tracker: str, options: dict[str, Any], words: str) -> None:
    with pytest.raises(tb.InputError, match=words):
        tb.doctor(tracker, **options)


def test_a_folder_with_something_else_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(tb.TrackbenchError):
        tb.doctor("highway#ekf_cv", out=tmp_path)


@pytest.mark.usefixtures("importable")
def test_a_tracker_that_cannot_step_is_not_examined() -> None:
    with pytest.raises(CannotRun, match="rho"):
        tb.doctor("doubled_noise:Raises", in_process=True)
