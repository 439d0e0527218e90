"""The commands that show and read recordings, as their user meets them."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.commands import run_command
from tests.support.recordings import ReadRecording

from trackbench.document.palette import TRACKER_COLOURS
from trackbench.results import Result
from trackbench.subjects.recording import viewer

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
    lines = done.out.splitlines()
    assert lines[0] == "tiny: run 0 of 4, 2 vehicles, 2.0 s, seed 7"
    assert any(line.startswith("results/tiny/recording.rrd: written by Rerun 0.41") for line in lines)
    assert {"raw", "ekf"} <= {line.split()[0] for line in lines if line}
    assert lines[-1] == "results/tiny/runs.parquet: the same"
    assert max(len(line) for line in lines if not line.startswith(("python", "measurements:"))) <= 80
    of_folder = cli("inspect", "results/tiny")
    assert of_folder.out == done.out


def test_a_tracker_alone_keeps_its_colour_in_report_and_recording(cli: Cli, folder: Path) -> None:
    assert cli("run", "tiny.yaml", "--trackers", "ekf", "--out", "alone").status == 0
    alone, colour = folder.parents[1] / "alone" / "tiny", TRACKER_COLOURS[list(Result.load(folder)).index("ekf")]
    assert f'style="--mark: {colour}"></span>ekf</td>' in (alone / "report.html").read_text(encoding="utf-8")
    recorded = ReadRecording(alone / "recording.rrd")
    assert recorded("/world/estimates/ekf/v1", "Points2D:colors")[None] == [int(colour[1:] + "FF", 16)]


def test_inspect_prints_json_and_nothing_else(cli: Cli, folder: Path) -> None:
    done = cli("inspect", "results/tiny", "--json", "--at", "1", "--worst", "2")
    inspected = json.loads(done.out, parse_constant=pytest.fail)
    assert done.err == ""
    assert inspected["at"]["time_s"] == 1.0
    assert {name: len(moments) for name, moments in inspected["worst"].items()} == {"raw": 2, "ekf": 2}
    assert inspected["fingerprint"] == Result.load(folder).summary.fingerprint


def test_inspect_prints_moments(cli: Cli, folder: Path) -> None:
    at = cli("inspect", "results/tiny", "--at", "1.23")
    assert "At 1.200 s" in at.out
    assert any(line.split()[:2] == ["v1", "ekf"] for line in at.out.splitlines())
    worst = cli("inspect", "results/tiny", "--worst", "2", "--tracker", "ekf")
    assert "raw" not in worst.out
    assert "ekf" in worst.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["inspect", "nothing.rrd"], "nothing.rrd: no such recording"),
        (["inspect", "tiny.yaml"], "tiny.yaml: not a Rerun recording (.rrd)"),
        (["view", "tiny.yaml"], "tiny.yaml: not a Rerun recording (.rrd)"),
        (["snapshot", "tiny.yaml", "--at", "1", "a.png"], "tiny.yaml: not a Rerun recording (.rrd)"),
        (["snapshot", "results/tiny", "--at", "9", "a.png"], "--at: 9 s is not in the recording"),
        (["snapshot", "results/tiny", "--at", "1", "a.jpg"], "name it a.png, not a.jpg"),
        (["snapshot", "results/tiny", "--at", "1", "--worst", "a.png"], "--at and --worst are two times"),
        (["snapshot", "results/tiny", "--worst", "--vehicle", "v9", "a.png"], "--vehicle: no vehicle 'v9' in this"),
        (["snapshot", "results/tiny", "--worst", "--tracker", "efk", "a.png"], "did you mean 'ekf'?"),
        (["snapshot", "results/tiny", "--worst", "999", "a.png"], "--worst: only "),
        (["view", "results/tiny", "--tracker", "ekf"], "give --worst with it"),
        (["view", "results/tiny", "--vehicle", "vv1"], "did you mean 'v1'?"),
        (["inspect", "results/tiny", "--worst", "--vehicle", "v9"], "--vehicle: no vehicle 'v9' in this"),
        (["inspect", "results/tiny", "--vehicle", "v1"], "give --worst with it"),
        (["inspect", "results/tiny", "--open"], "--open needs a time"),
        (["inspect", "results/tiny", "--tracker", "ekf"], "give --worst with it"),
        (["inspect", "results/tiny", "--worst", "1", "--tracker", "efk"], "did you mean 'ekf'?"),
        (["run", "tiny.yaml", "--connect", "localhost"], "write rerun+http://HOST:PORT/proxy"),
        (["run", "tiny.yaml", "--host", "0.0.0.0"], "says where --serve listens"),
        (["run", "tiny.yaml", "--serve", "--host", "192.0.2.1"], "192.0.2.1 is not an address of this machine"),
        (["run", "tiny.yaml", "--serve", "--connect", "x"], "either --connect or --serve"),
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


def test_a_recording_of_another_version_is_read_from_the_tables_beside_it(cli: Cli, folder: Path) -> None:
    before = cli("inspect", "results/tiny", "--json")
    file = folder / "recording.rrd"
    file.write_bytes(b"RRF2\x00\x16\x00\x00" + file.read_bytes()[8:])
    done = cli("inspect", "results/tiny", "--json")
    assert done.status == 0
    assert done.err.startswith("results/tiny/recording.rrd: it is of Rerun 0.22.0, which")
    assert done.err.endswith("read from its tables\n")
    assert json.loads(done.out)["trackers"] == json.loads(before.out)["trackers"]


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


def test_the_report_and_inspect_name_the_same_worst_moments(cli: Cli, folder: Path) -> None:
    worst = json.loads(cli("inspect", "results/tiny", "--worst", "--json").out)["worst"]
    report = (folder / "report.md").read_text(encoding="utf-8")
    section = report.partition("## Worst moments")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| **")]
    reported = {row.split("**")[1]: [cell.strip() for cell in row.split("|")[2:5]] for row in rows}
    assert {name: cells[:2] for name, cells in reported.items()} == {
        name: [f"{moments[0]['time_s']:.2f}", moments[0]["object"]] for name, moments in worst.items()
    }
    for name, (moment,) in worst.items():
        assert float(reported[name][2]) == pytest.approx(moment["position_error_m"], rel=0.01)
    assert "trackbench view . --worst --tracker ekf" in report


@pytest.mark.viewer
def test_the_viewer_opens_at_the_worst_moment(cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a screen here; with one the viewer has a window."""
    start, started = viewer.start_viewer, []

    def headless() -> viewer.Viewer:
        started.append(start("--headless"))
        return started[-1]

    monkeypatch.setattr(viewer, "start_viewer", headless)
    try:
        assert cli("inspect", "results/tiny", "--worst", "1", "--open").status == 0
        worst = json.loads(cli("inspect", "results/tiny", "--worst", "1", "--json").out)["worst"]
        (recording,) = started[0].wait().get_state().recordings
        expected = max((moments[0] for moments in worst.values()), key=lambda moment: moment["position_error_m"])
        assert recording.current_time == round(expected["time_s"] * 1e9)
        assert recording.store_id.startswith("Recording:")
    finally:
        for each in started:
            each.stop()


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
def test_a_viewer_without_a_driver_does_not_draw(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VK_DRIVER_FILES", "/nowhere")
    assert not viewer.draws()


@pytest.mark.parametrize("driver", [True, False])
def test_view_recommends_a_picture_only_where_there_is_a_driver(monkeypatch: pytest.MonkeyPatch, driver: bool) -> None:
    monkeypatch.setattr(viewer, "draws", lambda: driver)
    message = str(viewer.ended(io.BytesIO(b"neither WAYLAND_DISPLAY nor DISPLAY is set")))
    assert message.startswith(viewer.NO_SCREEN)
    assert ("trackbench snapshot" in message) is driver


def test_a_viewer_that_is_not_there_is_said(cli: Cli, tiny: Path) -> None:
    done = cli("run", "tiny.yaml", "--connect", "rerun+http://127.0.0.1:9/proxy", "--no-recording")
    assert done.status == 0
    assert done.err.startswith("no viewer answers at rerun+http://127.0.0.1:9/proxy")


@pytest.mark.viewer
def test_a_run_in_a_viewer_that_is_open(cli: Cli, tiny: Path) -> None:
    open_viewer = viewer.start_viewer("--headless")
    try:
        client = open_viewer.wait()
        done = cli("run", "tiny.yaml", "--connect", open_viewer.url, "--workers", "2", "--runs", "1500")
        assert (done.status, done.err) == (0, "")
        limit = time.monotonic() + 30
        while "Ranking" not in {view.name for view in client.get_state().views} and time.monotonic() < limit:
            time.sleep(0.2)
        state = client.get_state()
        assert {"Seen from above", "Ranking"} <= {view.name for view in state.views}
        assert [view.reports for view in state.views if view.reports] == []
        (timeline,) = state.recordings[0].timelines
        assert (timeline.name, timeline.start, timeline.end) == ("sim_time", 0, 2_100_000_000)
    finally:
        open_viewer.stop()


@pytest.mark.skipif(shutil.which("ss") is None, reason="nothing here lists the ports")
def test_a_served_run_listens_at_this_machine_alone_until_ctrl_c(tiny: Path, tmp_path: Path, trackbench: str) -> None:
    process = subprocess.Popen(
        [trackbench, "run", "tiny.yaml", "--serve", "--json", "--no-recording"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stderr is not None
        page = process.stderr.readline().split()[-1]
        port = int(page.split("/")[2].partition(":")[2])
        while not process.stderr.readline().startswith("Ctrl-C"):
            pass
        with socket.create_connection(("127.0.0.1", port), 5):
            pass
        listening = subprocess.run(["ss", "-Hltn"], capture_output=True, text=True, check=True).stdout
        (own,) = [line.split()[3] for line in listening.splitlines() if line.split()[3].endswith(f":{port}")]
        assert own == f"127.0.0.1:{port}"
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == 0
    assert json.loads(out)["scenario"]["name"] == "tiny"
    assert not viewer.listens("127.0.0.1", port)
    assert os.listdir(tmp_path / "results") == ["tiny"]
