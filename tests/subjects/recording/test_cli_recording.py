"""The commands that show and read recordings, as their user meets them."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.commands import run_command

from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.report.result import result_document
from trackbench.results import Result
from trackbench.subjects.recording import viewer
from trackbench.subjects.recording.focus import Opening, worst_moments

Cli = Callable[..., Any]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, tiny_text: str) -> Path:
    """A folder with the tiny scenario and its results."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "tiny.yaml").write_text(tiny_text, encoding="utf-8")
    assert run_command(folder, "run", "tiny.yaml", "--quiet") == 0
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """The results, as the test's own."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path / "results" / "tiny"


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)


def test_inspect_prints_what_is_in_a_recording(cli: Cli, folder: Path) -> None:
    done = cli("inspect", "results/tiny/recording.rrd")
    assert (done.status, done.err) == (0, "")
    assert {"raw", "ekf"} <= {line.split()[0] for line in done.out.splitlines() if line}
    assert "4 noise draws of ONE scene (2 vehicles, 2.0 s), seed 7" in done.out
    of_folder = cli("inspect", "results/tiny")
    assert of_folder.out == done.out


def test_inspect_prints_moments(cli: Cli, folder: Path) -> None:
    at = cli("inspect", "results/tiny", "--at", "1.23")
    assert "At 1.200 s" in at.out
    assert [line.split()[:2] for line in at.out.splitlines() if line.startswith("v1")] == [["v1", "raw"], ["v1", "ekf"]]
    worst = cli("inspect", "results/tiny", "--worst", "2", "--tracker", "ekf")
    assert "raw" not in worst.out
    assert "ekf" in worst.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["inspect", "nothing.rrd"], "nothing.rrd: no such recording"),
        (["view", "tiny.yaml"], "tiny.yaml: not a Rerun recording (.rrd)"),
        (["snapshot", "results/tiny", "--at", "9", "a.png"], "--at: 9 s is not in the recording"),
        (["snapshot", "results/tiny", "--at", "1", "a.jpg"], "name it a.png, not a.jpg"),
        (["snapshot", "results/tiny", "--at", "1", "a.png", "--worst"], "--at and --worst both choose a time"),
        (["snapshot", "results/tiny", "--worst", "--vehicle", "v9", "a.png"], "--vehicle: no vehicle 'v9' in this"),
        (["snapshot", "results/tiny", "--worst", "--tracker", "efk", "a.png"], "did you mean 'ekf'?"),
        (["snapshot", "results/tiny", "--worst", "999", "a.png"], "--worst: run 0, which is recorded, has "),
        (["view", "results/tiny", "--tracker", "ekf"], "give --worst with it"),
        (["view", "results/tiny", "--vehicle", "vv1"], "did you mean 'v1'?"),
        (["inspect", "results/tiny", "--worst", "1", "--at", "1"], "--at and --worst both choose a time"),
        (["snapshot", "results/tiny", "--worst", "a.png"], "'a.png' is not a valid integer"),
        (["inspect", "results/tiny", "--tracker", "ekf"], "give --worst with it"),
    ],
)
def test_mistakes_are_one_message(cli: Cli, folder: Path, arguments: list[str], message: str) -> None:
    # Tables take less time to read.
    (folder / "recording.rrd").unlink()
    done = cli(*arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.err
    assert "Traceback" not in done.err
    assert not list(folder.parents[1].glob("a.*"))


@pytest.mark.viewer
@pytest.mark.parametrize("moment", [["--at", "1"], ["--worst", "--vehicle", "v1"]])
def test_a_picture_of_a_recording(cli: Cli, folder: Path, moment: list[str]) -> None:
    done = cli("snapshot", "results/tiny/recording.rrd", *moment, "a.png")
    assert (done.status, done.out, done.err) == (0, "a.png\n", "")
    content = (folder.parents[1] / "a.png").read_bytes()
    assert content.startswith(b"\x89PNG")
    width, height = (int.from_bytes(content[i : i + 4], "big") for i in (16, 20))
    assert (width, height) == viewer.SIZE
    assert len(content) > 50_000, "an empty window takes less"


def test_without_a_driver_it_says_what_to_install(cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VK_DRIVER_FILES", "/none")
    monkeypatch.setenv("VK_ICD_FILENAMES", "/none")
    done = cli("snapshot", "results/tiny", "--at", "1", "a.png")
    assert done.status == 2
    assert "apt-get install mesa-vulkan-drivers" in done.err
    assert len(done.err.splitlines()) == 1
    assert not (folder.parents[1] / "a.png").exists()


def test_the_report_and_inspect_name_the_same_worst_moments(folder: Path) -> None:
    result = Result.load(folder)
    ((caption, replay),) = ((each.caption, each.replay) for each in result_document(result).figures if each.replay)
    listed = caption.partition("Largest errors: ")[2].partition(". ")[0].rstrip(".").split("; ")
    assert "ekf" in replay.shown
    for name, text in zip(replay.shown, listed, strict=True):
        (moment,) = worst_moments(result, Opening(worst=1, tracker=name))
        assert isinstance(moment, EstimateMoment)
        assert text.endswith(f" m, {moment.object} at {moment.time_s:.2f} s")
        assert float(text.split()[0]) == pytest.approx(moment.position_error_m, abs=0.01)


@pytest.mark.viewer
def test_the_viewer_opens_at_the_worst_moment(cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a screen here; with one the viewer has a window."""
    started = headless_viewers(monkeypatch)
    try:
        assert cli("view", "results/tiny", "--worst", "1").status == 0
        (recording,) = started[0].wait().get_state().recordings
        (expected,) = worst_moments(Result.load(folder), Opening(worst=1))
        assert recording.current_time == round(expected.time_s * 1e9)
        assert recording.store_id.startswith("Recording:")
    finally:
        for each in started:
            each.stop()


def headless_viewers(monkeypatch: pytest.MonkeyPatch) -> list[viewer.Viewer]:
    """The viewers that are started from now on, without a screen."""
    start, started = viewer.start_viewer, list[viewer.Viewer]()

    def headless() -> viewer.Viewer:
        started.append(start("--headless"))
        return started[-1]

    monkeypatch.setattr(viewer, "start_viewer", headless)
    return started


@pytest.mark.usefixtures("no_screen")
def test_without_a_screen_view_says_so_and_a_run_goes_on(cli: Cli, folder: Path) -> None:
    done = cli("view", "results/tiny")
    assert (done.status, done.out) == (2, "")
    assert viewer.NO_SCREEN in done.err
    assert "`trackbench inspect RUN --worst 3`" in done.err
    run = cli("run", "tiny.yaml", "--live")
    assert run.status == 0
    assert "the run goes on without a viewer" in run.err


@pytest.mark.viewer
def test_a_run_is_shown_while_it_goes_on(cli: Cli, tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = headless_viewers(monkeypatch)
    try:
        done = cli("run", "tiny.yaml", "--live", "--workers", "2", "--runs", "1500")
        assert (done.status, done.err) == (0, "")
        client = started[0].wait()
        limit = time.monotonic() + 30
        while "Ranking" not in {view.name for view in client.get_state().views} and time.monotonic() < limit:
            time.sleep(0.2)
        state = client.get_state()
        assert {"Seen from above", "Ranking"} <= {view.name for view in state.views}
        assert [view.reports for view in state.views if view.reports] == []
        (timeline,) = state.recordings[0].timelines
        assert (timeline.name, timeline.start, timeline.end) == ("sim_time", 0, 2_100_000_000)
    finally:
        for each in started:
            each.stop()
