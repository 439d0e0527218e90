"""Plug-ins that print, ask for input or are interrupted in the process of a command."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.support.hostile import OF_THE_BENCH, scenario

PLUGINS = """\
import ctypes, os, subprocess, sys, threading, time
from trackbench.metrics import Metric
from trackbench.models.motion.cv import ConstantVelocity
from trackbench.models.sensors.lidar import Lidar
from trackbench.truth.sources import ScriptedTruth

def act():
    %s


"""

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
def test_a_signal_ends_the_command(begin: Begin, tmp_path: Path, number: signal.Signals) -> None:
    process = begin("motion", "open('under_way', 'w').close(); time.sleep(600)")
    limit = time.monotonic() + 240
    while not (tmp_path / "under_way").exists():
        assert time.monotonic() < limit
        time.sleep(0.02)
    process.send_signal(number)
    assert process.communicate(timeout=60) == ("", "interrupted: the unfinished run was not kept\n")
    assert process.returncode == 130
    assert list((tmp_path / "results").iterdir()) == []
