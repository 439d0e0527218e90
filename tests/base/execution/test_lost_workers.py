"""A run of which plug-ins end the workers ends, and says how they did: on this machine, and on a cluster on it."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.hostile import OF_THE_BENCH, PLUG_INS, scenario

WHERE = ["--workers 2", "--cluster local:2"]
#: By kind of plug-in: what it does in a worker, and how that is told.
ACTS = {
    "motion": ("posix._exit(0)", "ended itself, with status 0"),
    "metric": ("ctypes.string_at(0)", "was killed by signal 11 (SIGSEGV)"),
    "sensor": ("os.kill(os.getpid(), signal.SIGKILL)", "was killed by signal 9 (SIGKILL)"),
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
    how = "a second worker has ended" if "workers" in where else "2 of 2 workers have ended"
    assert done.stderr.splitlines()[-1] == f"trackbench: no result: {how}: its process {cause}"
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
