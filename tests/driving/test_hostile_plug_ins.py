"""Trackers that do their worst, metrics with mistakes: no status 0 without a result; who is at fault is named."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.support.hostile import ACTS, module, scenario

from trackbench.results import Result

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are told by /proc")
#: Time after a command in which what it started may end, s.
AFTERMATH = 3.0
#: What somebody does in a metric by mistake; it runs in the process of the command.
MISTAKES = (
    *("raises", "raises_lines", "raises_half_a_character", "raises_without_text", "raises_an_os_error"),
    *("raises_a_broken_pipe", "raises_a_memory_error", "raises_a_stop_iteration", "raises_cancelled", "raises_base"),
    *("exits", "exits_with_text", "recurses", "leaves", "leaves_at_the_end", "segfaults", "aborts", "kills_itself"),
    *("leaves_a_child", "leaves_a_thread", "closes_stdout", "breaks_pickle", "makes_the_folder_a_file"),
)
CASES = [*(("tracker", act) for act in ACTS), *(("metric", act) for act in MISTAKES)]
#: What Python itself prints of errors that nothing catches is a tracker's output, which is passed on.
PRINTING = {"raises_in_a_thread", "raises_as_it_is_deleted", "logs_nonsense"}
#: These are tried in every run of the tests.
FAST = {("tracker", "leaves"), ("metric", "leaves"), ("metric", "breaks_pickle"), ("metric", "makes_the_folder_a_file")}


def marked(process: Path, mark: str) -> bool:
    """Whether a process in /proc was started with a mark in its environment, and has not ended."""
    try:
        alive = process.joinpath("stat").read_text().rpartition(")")[2].split()[0] != "Z"
        return alive and mark.encode() in process.joinpath("environ").read_bytes()
    except OSError:
        return False


def left(mark: str) -> Iterator[str]:
    """The commands of the processes with a mark."""
    for process in Path("/proc").glob("[0-9]*"):
        if marked(process, mark):
            yield process.joinpath("cmdline").read_bytes().replace(b"\0", b" ").decode()


@pytest.mark.parametrize(
    ("kind", "act"), [case if case in FAST else pytest.param(*case, marks=pytest.mark.slow) for case in CASES]
)
def test_no_plug_in_answers_for_the_bench(tmp_path: Path, trackbench: str, kind: str, act: str) -> None:
    (tmp_path / "plug.py").write_text(module(act), encoding="utf-8")
    (tmp_path / "plugged.yaml").write_text(scenario(kind), encoding="utf-8")
    mark = f"HOSTILE={tmp_path}"
    done = subprocess.run(
        [trackbench, "run", "plugged.yaml", "--no-recording", "--quiet", "--tracker-timeout", "20"],
        cwd=tmp_path, env={**os.environ, "HOSTILE": str(tmp_path)},
        capture_output=True, text=True, errors="replace", check=False, timeout=300,
    )  # fmt: skip
    until = time.monotonic() + AFTERMATH
    while (processes := [*left(mark)]) and time.monotonic() < until:
        time.sleep(0.1)
    assert not processes
    assert "Traceback" not in done.stderr or (kind == "tracker" and act in PRINTING)
    cannot_write = act in ("makes_results_a_file", "makes_the_folder_a_file")
    assert done.returncode in ((4,) if cannot_write else (0, 2, 3, 70)), done.stderr
    if done.returncode == 0:
        result = Result.load(tmp_path / "results" / "plugged")
        assert all(tracker.failed is None for tracker in result.summary.trackers)
        for metric in ("position_rmse", "velocity_rmse"):
            assert result["ekf"].metrics[metric].value is not None
    elif done.returncode == 70:
        assert kind == "metric"
        assert "no result: the process of the command " in done.stderr
    elif not (cannot_write and kind == "tracker"):
        # A tracker has a name in the scenario. Who changed a folder from another process is not known.
        names = ("FAILED mine: ", "plug.py") if kind == "tracker" else (f"plug:{kind}", "plug.py")
        assert any(name in done.stdout + done.stderr for name in names), done.stdout + done.stderr
    assert not [*(tmp_path / "results").glob("*.unfinished")]
