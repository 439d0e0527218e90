"""Whatever a plug-in does to the process of a command, the shell gets a status that is true, and is told who did it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.support.hostile import OF_THE_BENCH, scenario

from trackbench.base.descendants import descendants

PLUGINS = """\
import asyncio, atexit, ctypes, logging, os, pathlib, posix, shutil, signal, subprocess, sys, threading, time
from trackbench.metrics import Metric
from trackbench.models.motion.cv import ConstantVelocity
from trackbench.models.sensors.lidar import Lidar
from trackbench.truth.sources import ScriptedTruth

def act():
    %s


"""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="orphans are adopted on Linux")


def first_is_fast(cases: Iterable[str]) -> list[Any]:
    """The first of some cases as it is, the others marked as slow."""
    first, *others = cases
    return [first, *(pytest.param(case, marks=pytest.mark.slow) for case in others)]


Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def run(tmp_path: Path, trackbench: str) -> Run:
    """Runs a scenario in which one kind of plug-in acts."""

    def call(
        kind: str, act: str, *options: str, below: float = 100.0, new_session: bool = False
    ) -> subprocess.CompletedProcess[str]:
        (tmp_path / "plug.py").write_text(PLUGINS % act + OF_THE_BENCH, encoding="utf-8")
        (tmp_path / "plugged.yaml").write_text(scenario(kind, below), encoding="utf-8")
        command = [trackbench, "run", "plugged.yaml", "--no-recording", "--quiet", *options]
        return subprocess.run(
            command,
            cwd=tmp_path,
            start_new_session=new_session,
            capture_output=True,
            text=True,
            check=False,
            timeout=240,
        )

    return call


@pytest.fixture
def begun(request: pytest.FixtureRequest, tmp_path: Path, trackbench: str) -> Iterator[subprocess.Popen[str]]:
    """A run whose motion model has started a process in a session of its own, and does what the parameter says."""
    child = "subprocess.Popen(['sleep', '600'], start_new_session=True)"
    act = f"{child}; open('under_way', 'w').close(); {getattr(request, 'param', 'time.sleep(600)')}"
    (tmp_path / "plug.py").write_text(PLUGINS % act + OF_THE_BENCH, encoding="utf-8")
    (tmp_path / "plugged.yaml").write_text(scenario("motion"), encoding="utf-8")
    process = subprocess.Popen([trackbench, "run", "plugged.yaml"], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    wait_for(tmp_path / "under_way")
    yield process
    process.kill()
    process.communicate()


#: By what a plug-in does: its kind, its code, how the end of the process is told, and whether the line is known.
ENDINGS = {
    "leaves": ("motion", "os._exit(0)", "its process ended itself, with status 0", True),
    "leaves_by_posix": ("metric", "posix._exit(0)", "its process ended itself, with status 0", True),
    "leaves_by_libc": ("sensor", "ctypes.CDLL(None).exit(0)", "its process ended itself, with status 0", False),
    "leaves_in_a_thread": (
        "truth",
        "threading.Thread(target=os._exit, args=(0,)).start(); time.sleep(60)",
        "its process ended itself, with status 0",
        False,
    ),
    "becomes_another": ("metric", "os.execv('/bin/true', ['true'])", "its process ended itself, with status 0", True),
    "becomes_one_that_stays": (
        "motion",
        "os.execlp('sleep', 'sleep', '600')",
        "its process became another program, or closed its files",
        True,
    ),
    "closes_all_files": (
        "truth",
        "os.closerange(3, 4096); time.sleep(60)",
        "its process became another program, or closed its files",
        False,
    ),
    "goes_on_as_a_copy": ("sensor", "if os.fork(): os._exit(0)", "its process ended itself, with status 0", True),
    "segfaults": ("metric", "ctypes.string_at(0)", "its process was killed by signal 11 (SIGSEGV)", True),
    "aborts": ("motion", "os.abort()", "its process was killed by signal 6 (SIGABRT)", True),
    "kills_itself": (
        "truth",
        "os.kill(os.getpid(), signal.SIGKILL)",
        "its process was killed by signal 9 (SIGKILL)",
        False,
    ),
}


@pytest.mark.parametrize("name", first_is_fast(ENDINGS))
def test_a_plug_in_that_ends_the_process_is_named(run: Run, tmp_path: Path, name: str) -> None:
    kind, act, cause, known = ENDINGS[name]
    done = run(kind, act)
    place = " (plug.py:8, in act)" if known else ""
    assert done.stderr == f"trackbench: no result: {cause}{place}, while 'plug:{kind}' was at work\n"
    assert (done.returncode, done.stdout) == (2, "")
    assert list((tmp_path / "results").iterdir()) == []


#: How a plug-in may send its process a signal to end, which nobody else gets.
SIGNALS = {
    "terminates": ("motion", "os.kill(os.getpid(), signal.SIGTERM)", "15 (SIGTERM)"),
    "interrupts": ("metric", "signal.raise_signal(signal.SIGINT)", "2 (SIGINT)"),
    "terminates_by_libc": ("sensor", "ctypes.CDLL(None).kill(os.getpid(), 15)", "15 (SIGTERM)"),
    "interrupts_from_a_thread": (
        "truth",
        "threading.Thread(target=os.kill, args=(os.getpid(), 2)).start(); time.sleep(60)",
        "2 (SIGINT)",
    ),
}


@pytest.mark.parametrize("name", first_is_fast(SIGNALS))
def test_a_plug_in_that_sends_its_process_a_signal_is_named(run: Run, tmp_path: Path, name: str) -> None:
    kind, act, number = SIGNALS[name]
    done = run(kind, act)
    assert done.stderr == (
        f"trackbench: no result: its process alone was sent signal {number} (plug.py:8, in act), "
        f"while 'plug:{kind}' was at work\n"
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert list((tmp_path / "results").iterdir()) == []


#: What a plug-in raises that ends a run, by its kind; a metric that raises has no value.
RAISED = {
    "GeneratorExit": "truth",
    "asyncio.CancelledError": "truth",
    "KeyboardInterrupt": "truth",
    "EOFError": "truth",
    "BaseException": "sensor",
    "SystemExit(0)": "sensor",
}


@pytest.mark.parametrize("raised", first_is_fast(RAISED))
def test_a_plug_in_that_raises_strangely_is_named(run: Run, raised: str) -> None:
    done = run(RAISED[raised], f"raise {raised}")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "(plug.py:8, in act)" in done.stderr
    assert len(done.stderr.splitlines()) == 1


#: What a plug-in may do to the end of a process.
AFTERWARDS = [
    "atexit.register(os._exit, 0)",
    "sys.exit = lambda status=0: os._exit(0)",
    "atexit.register(time.sleep, 600)",
    "threading.Thread(target=time.sleep, args=(600,)).start()",
    "os.fork()",
]


@pytest.mark.parametrize("act", first_is_fast(AFTERWARDS))
def test_the_status_is_that_of_the_result(run: Run, tmp_path: Path, act: str) -> None:
    done = run("motion", act, "--json", below=1e-9)
    assert done.returncode == 1, done.stderr
    summary = json.loads(done.stdout)
    assert summary == json.loads((tmp_path / "results/plugged/result.json").read_text(encoding="utf-8"))
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["plugged"]


@pytest.mark.parametrize("kind", first_is_fast(["motion", "sensor", "truth", "metric"]))
def test_a_plug_in_that_changes_the_folder_does_not_move_the_result(run: Run, tmp_path: Path, kind: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    done = run(kind, "os.chdir('/tmp')", "--out", "here")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "here/plugged/result.json").is_file()


@pytest.mark.slow
def test_a_module_that_ends_the_process_while_it_is_imported(run: Run) -> None:
    done = run("metric", "pass\nos._exit(0)")
    assert done.returncode == 2
    assert done.stderr == (
        "trackbench: no result: its process ended itself, with status 0 (plug.py:9, in <module>), "
        "while 'plug:metric' was at work\n"
    )


INTERRUPTED = "interrupted while 'plug:motion' was at work: the unfinished run was not kept\n"


@pytest.mark.slow
def test_a_plug_in_that_ends_its_group_is_named(run: Run) -> None:
    done = run("motion", "os.killpg(0, signal.SIGTERM)", new_session=True)
    assert (done.returncode, done.stderr) == (130, INTERRUPTED)


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 3])
def test_ctrl_c_ends_a_plug_in_that_does_not_listen(run: Run, tmp_path: Path, trackbench: str, times: int) -> None:
    ignoring = "signal.signal(signal.SIGINT, signal.SIG_IGN); signal.signal(signal.SIGTERM, signal.SIG_IGN); "
    act = f"{ignoring if times > 1 else ''}open('under_way', 'w').close(); time.sleep(600)"
    (tmp_path / "plug.py").write_text(PLUGINS % act + OF_THE_BENCH, encoding="utf-8")
    (tmp_path / "plugged.yaml").write_text(scenario("motion", below=1), encoding="utf-8")
    process = subprocess.Popen(
        [trackbench, "run", "plugged.yaml"], cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    wait_for(tmp_path / "under_way")
    for _ in range(times):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.7)
    assert process.communicate(timeout=60)[1] == INTERRUPTED
    assert process.returncode == 130
    assert list((tmp_path / "results").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_from_outside_is_no_fault_of_the_plug_in_at_work(
    begun: subprocess.Popen[str], tmp_path: Path, number: signal.Signals
) -> None:
    begun.send_signal(number)
    assert begun.communicate(timeout=60)[1] == INTERRUPTED
    assert begun.returncode == 130


#: Machine code that no signal reaches and that holds Python's lock: a mutex that is locked twice.
STUCK = "lock = ctypes.PyDLL(None).pthread_mutex_lock; mutex = bytes(64); lock(mutex); lock(mutex)"


@pytest.mark.slow
@pytest.mark.parametrize("begun", ["time.sleep(600)", STUCK], indirect=True)
def test_nothing_outlives_a_supervisor_that_is_killed(begun: subprocess.Popen[str], tmp_path: Path) -> None:
    before = list(descendants(begun.pid))
    assert len(before) >= 3, "the command, what watches it, and what the plug-in has started"
    begun.kill()
    limit = time.monotonic() + 60
    while alive := [process for process in before if Path(f"/proc/{process}/exe").exists()]:
        assert time.monotonic() < limit, alive
        time.sleep(0.1)
    assert list((tmp_path / "results").iterdir()) == []


def test_without_a_supervisor_for_a_debugger(run: Run, tmp_path: Path) -> None:
    assert run("motion", "open('parent', 'w').write(str(os.getppid()))", "--in-process").returncode == 0
    assert int((tmp_path / "parent").read_text()) == os.getpid()


def wait_for(file: Path) -> None:
    limit = time.monotonic() + 240
    while not file.exists():
        assert time.monotonic() < limit
        time.sleep(0.02)


#: Before an act that is done at its first call alone.
ONCE = "if hasattr(sys, 'acted'): return\n    sys.acted = True; "
#: How a metric may take the result away, or keep it from being written.
LOST = [
    "os.replace = os.rename = lambda *_, **__: None",
    "atexit.register(shutil.rmtree, 'results')",
    "atexit.register(pathlib.Path('results/plugged/breakdown.parquet').unlink)",
    "atexit.register(pathlib.Path('results/plugged/result.json').write_text, '{}')",
]


@pytest.mark.parametrize("act", first_is_fast(LOST))
def test_a_result_that_is_not_there_as_it_was_written_is_none(run: Run, act: str) -> None:
    done = run("metric", ONCE + act)
    assert done.returncode == 2
    file = "breakdown.parquet" if "breakdown" in act else "result.json"
    assert done.stderr == (
        f"trackbench: no result: results/plugged/{file} is not there as it was written, "
        "with the plug-in 'plug:metric'\n"
    )


@pytest.mark.slow
def test_a_file_that_is_not_written_is_named(run: Run) -> None:
    done = run("metric", ONCE + "pathlib.Path.write_text = pathlib.Path.write_bytes = lambda *_, **__: 0")
    why = "result.json was not written, with the plug-in 'plug:metric'"
    assert (done.returncode, done.stderr) == (4, f"trackbench: cannot write results/plugged: {why}\n")


@pytest.mark.slow
def test_an_older_result_is_not_taken_for_that_of_the_run(run: Run) -> None:
    assert run("metric", "pass").returncode == 0
    done = run("metric", "os.replace = lambda *_, **__: None", "--seed", "8")
    assert (done.returncode, done.stderr.partition(":")[0]) == (2, "trackbench")


#: Errors that nothing catches.
UNCAUGHT = {
    "atexit.register(lambda: 1 / 0)": "ZeroDivisionError: division by zero (plug.py:9, in <lambda>)",
    "thread = threading.Thread(target=lambda: 1 / 0); thread.start(); thread.join()": (
        "ZeroDivisionError: division by zero (plug.py:9, in <lambda>)"
    ),
    "type('D', (), {'__del__': lambda self: 1 / 0})()": "ZeroDivisionError: division by zero (plug.py:9, in <lambda>)",
    "logging.error('%d', 'x')": "TypeError: %d format: a real number is required, not str (plug.py:9, in act)",
}


@pytest.mark.parametrize("act", first_is_fast(UNCAUGHT))
def test_an_error_that_nothing_catches_is_one_line(run: Run, act: str) -> None:
    done = run("metric", ONCE + act)
    assert done.returncode == 0
    assert done.stderr == f"'plug:metric': an error that nothing caught: {UNCAUGHT[act]}\n"


#: What becomes of a standard stream that is closed, or of the rights of files: status and what is said.
TAKEN = {
    "sys.stdout.close()": (0, ""),
    "os.close(1)": (
        0,
        "trackbench: 'plug:metric' has closed standard output, or sent it elsewhere; it is as before again",
    ),
    "os.close(1); os.close(2)": (
        0,
        "trackbench: 'plug:metric' has closed standard error, or sent it elsewhere; it is as before again",
    ),
    "sys.__stdout__.close()": (4, "trackbench: standard output was closed, with the plug-in 'plug:metric'"),
    "sys.__stdout__.close(); sys.__stderr__.close()": (
        4,
        "trackbench: standard output was closed, with the plug-in 'plug:metric'",
    ),
    "os.umask(0o777)": (0, ""),
    "__import__('resource').setrlimit(7, (5, 5))": (
        2,
        "trackbench: too many open files; raise the limit (ulimit -n), with the plug-in 'plug:metric'",
    ),
}


@pytest.mark.parametrize("act", first_is_fast(TAKEN))
def test_what_a_plug_in_takes_away_comes_back_or_is_said(run: Run, tmp_path: Path, act: str) -> None:
    status, text = TAKEN[act]
    done = run("metric", ONCE + act)
    assert (done.returncode, done.stderr.strip()) == (status, text)
    assert bool(done.stdout) == (status == 0)
    if status == 0:
        assert (tmp_path / "results/plugged/result.json").stat().st_mode & 0o600 == 0o600


def test_a_module_that_closes_stdout_as_it_is_imported(run: Run) -> None:
    done = run("metric", "pass\nsys.stdout.close()")
    assert (done.returncode, done.stderr) == (0, "")


def test_what_a_plug_in_prints_is_capped_and_cannot_steer_the_terminal(run: Run) -> None:
    done = run("metric", ONCE + "print('\\x1b[2J\\0' + 'line\\n' * 1000)", "--json")
    assert json.loads(done.stdout)
    lines = done.stderr.splitlines()
    assert lines[0] == " [2J line"
    assert lines[100:] == [
        "'plug:metric': what it prints from here on is not shown",
        "'plug:metric' printed 901 lines more, which were not shown",
    ]
