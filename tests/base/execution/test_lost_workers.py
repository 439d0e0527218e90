"""A run of which plug-ins end the workers ends, and says how they did: on this machine, and on a cluster on it."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.hostile import OF_THE_BENCH, PLUG_INS, scenario
from tests.support.processes import descendants

WHERE = ["--workers 2", "--cluster local:2"]
#: By kind of plug-in: what it does in a worker, and how that is told.
ACTS = {
    "motion": ("posix._exit(0)", ""),
    "metric": ("ctypes.string_at(0)", " (SIGSEGV(-11))"),
    "sensor": ("os.kill(os.getpid(), signal.SIGKILL)", " (SIGKILL(-9))"),
}
Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def run(tmp_path: Path, trackbench: str) -> Run:
    """Runs a scenario of several blocks, in which one kind of plug-in acts, in workers."""

    def call(kind: str, act: str, where: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "plug.py").write_text(PLUG_INS.replace("{act}", act) + OF_THE_BENCH, encoding="utf-8")
        (tmp_path / "plugged.yaml").write_text(scenario(kind), encoding="utf-8")
        command = [trackbench, "run", "plugged.yaml", "--no-recording", "--quiet", "--runs", "4000", *where.split()]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=240)

    return call


@pytest.mark.slow
@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("kind", ACTS)
def test_a_plug_in_that_ends_workers_ends_the_run(run: Run, tmp_path: Path, where: str, kind: str) -> None:
    act, cause = ACTS[kind]
    done = run(kind, act, where)
    how = cause if "workers" in where else ""
    message = f"trackbench: no result: the process of a worker ended{how}, "
    assert done.stderr.splitlines()[-1].startswith(message)
    assert "Traceback" not in done.stderr
    assert (done.returncode, done.stdout) == (2, "")
    assert list((tmp_path / "results").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("raised", ["SystemExit(0)", "KeyboardInterrupt"])
def test_what_a_plug_in_raises_in_a_worker_is_no_status_of_the_command(run: Run, where: str, raised: str) -> None:
    done = run("sensor", f"raise {raised}", where)
    shown = raised.replace("(0)", ": 0")
    assert done.stderr == f"trackbench: a plug-in failed: {shown} (plug.py:19, in misbehave)\n"
    assert (done.returncode, done.stdout) == (2, "")


@pytest.mark.slow
@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_workers_end_with_the_command(tmp_path: Path, trackbench: str, where: str, number: signal.Signals) -> None:
    under_way = tmp_path / "under_way"
    act = "open('under_way', 'w').close(), __import__('time').sleep(600)"
    (tmp_path / "plug.py").write_text(PLUG_INS.replace("{act}", act) + OF_THE_BENCH, encoding="utf-8")
    (tmp_path / "plugged.yaml").write_text(scenario("metric"), encoding="utf-8")
    command = [trackbench, "run", "plugged.yaml", "--no-recording", "--quiet", "--runs", "4000", *where.split()]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    limit = time.monotonic() + 240
    while not under_way.exists():
        assert time.monotonic() < limit
        time.sleep(0.05)
    below = [*descendants(process.pid)]
    assert len(below) >= 3
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    if number == signal.SIGINT:
        assert errors == "interrupted: the unfinished run was not kept\n"
    while any(Path(f"/proc/{each}/exe").exists() for each in below):
        assert time.monotonic() < limit
        time.sleep(0.05)
    assert not (tmp_path / "results" / "plugged").exists()
