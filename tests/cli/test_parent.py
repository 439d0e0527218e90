"""Whatever ends the process of a command, the shell gets a status that is true, and no child is left."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.support.hostile import OF_THE_BENCH, scenario
from tests.support.processes import descendants

PLUGINS = """\
import ctypes, os, subprocess, sys, threading, time
from trackbench.metrics import Metric
from trackbench.models.motion.cv import ConstantVelocity
from trackbench.models.sensors.lidar import Lidar
from trackbench.truth.sources import ScriptedTruth

def act():
    %s


"""

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="a command has no process of its own")

Begin = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def begin(tmp_path: Path, trackbench: str) -> Iterator[Begin]:
    """Begins a run of a scenario in which a plug-in of one kind acts."""
    begun: list[subprocess.Popen[str]] = []

    def call(kind: str, act: str, *options: str) -> subprocess.Popen[str]:
        (tmp_path / "plug.py").write_text(PLUGINS % act + OF_THE_BENCH, encoding="utf-8")
        (tmp_path / "plugged.yaml").write_text(scenario(kind, 100.0), encoding="utf-8")
        command = [trackbench, "run", "plugged.yaml", "--no-recording", "--quiet", *options]
        begun.append(subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
        return begun[-1]

    yield call
    for process in begun:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(
    ("kind", "act", "cause"),
    [
        ("metric", "os._exit(0)", "ended itself, with status 0"),
        pytest.param("motion", "ctypes.string_at(0)", "was killed by SIGSEGV", marks=pytest.mark.slow),
        pytest.param("truth", "os.kill(os.getpid(), 9)", "was killed by SIGKILL", marks=pytest.mark.slow),
    ],
)
def test_an_end_without_a_status_is_said(begin: Begin, tmp_path: Path, kind: str, act: str, cause: str) -> None:
    process = begin(kind, act)
    output, errors = process.communicate(timeout=240)
    assert (process.returncode, output) == (70, "")
    assert f"no result: the process of the command {cause}" in errors.splitlines()[-1]
    assert not (tmp_path / "results/plugged").exists()


def test_what_plug_ins_threads_and_children_print_is_no_part_of_the_answer(begin: Begin, tmp_path: Path) -> None:
    prints = "print('metric'); threading.Thread(target=print, args=('thread',)).start(); os.system('echo child')"
    process = begin("metric", prints, "--json")
    output, errors = process.communicate(timeout=240)
    assert process.returncode == 0, errors
    stored = json.loads((tmp_path / "results/plugged/result.json").read_text(encoding="utf-8"))
    assert json.loads(output) == {key: value for key, value in stored.items() if key != "tables"}
    assert {"metric", "thread", "child"} <= set(errors.split())


def test_a_plug_in_that_asks_for_input_is_no_interruption(begin: Begin) -> None:
    process = begin("sensor", "input()")
    output, errors = process.communicate(timeout=240)
    assert (process.returncode, output) == (2, "")
    assert "a plug-in failed: EOFError" in errors
    assert "(plug.py:8, in act)" in errors


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_a_signal_to_the_command_ends_it_and_its_children(begin: Begin, tmp_path: Path, number: signal.Signals) -> None:
    process = begin("motion", "subprocess.Popen(['sleep', '600']); open('under_way', 'w').close(); time.sleep(600)")
    below = _processes(process, tmp_path / "under_way")
    process.send_signal(number)
    assert process.communicate(timeout=60) == ("", "interrupted: the unfinished run was not kept\n")
    assert process.returncode == 130
    assert _ended(below)
    assert list((tmp_path / "results").iterdir()) == []


def test_the_third_signal_kills_a_command_that_does_not_listen(begin: Begin, tmp_path: Path) -> None:
    ignoring = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)"
    process = begin("motion", f"{ignoring}; open('under_way', 'w').close(); time.sleep(600)")
    below = _processes(process, tmp_path / "under_way")
    for _ in range(3):
        process.send_signal(signal.SIGINT)
        time.sleep(0.2)
    assert process.communicate(timeout=60) == ("", "interrupted: the unfinished run was not kept\n")
    assert process.returncode == 130
    assert _ended(below)


@pytest.mark.skipif(sys.platform != "linux", reason="prctl(2)")
def test_the_command_ends_with_a_parent_that_is_killed(begin: Begin, tmp_path: Path) -> None:
    process = begin("motion", "open('under_way', 'w').close(); time.sleep(600)")
    below = _processes(process, tmp_path / "under_way")
    process.kill()
    assert _ended(below)
    assert not (tmp_path / "results/plugged").exists()


def test_no_process_of_its_own_for_a_debugger(begin: Begin, tmp_path: Path) -> None:
    process = begin("motion", "open('parent', 'w').write(str(os.getppid()))", "--in-process")
    assert process.communicate(timeout=240)[1] == ""
    assert int((tmp_path / "parent").read_text(encoding="utf-8")) == os.getpid()


def _processes(process: subprocess.Popen[str], under_way: Path) -> list[int]:
    """Wait until a plug-in acts, and return the processes below that of the shell."""
    limit = time.monotonic() + 240
    while not under_way.exists():
        assert time.monotonic() < limit
        time.sleep(0.02)
    below = list(descendants(process.pid))
    assert below
    return below


def _ended(processes: list[int]) -> bool:
    limit = time.monotonic() + 30
    while any(Path(f"/proc/{process}/exe").exists() for process in processes):
        if time.monotonic() > limit:
            return False
        time.sleep(0.05)
    return True
