"""Whatever a tracker started is ended, also where any one process of the bench is killed; and what it may take."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from tests.support.processes import children, descendants

from trackbench.driving.isolation import Isolation, container_memory
from trackbench.results import Result

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are told by /proc")

#: How long a test waits on a busy machine, s.
PATIENCE = 240.0
SCENARIO = """\
name: left
truth: {source: scripted, duration_s: 1, rate_hz: 10, objects: {car: {start: {x: 20, y: 5, speed_mps: 10}}}}
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}
trackers:
  raw: {use: raw}
  mine: {use: "mine:Mine"}
score: {settle_s: 0}
monte_carlo: {runs: 2, seed: 7}
"""

CHILDREN = """\
import os, time

class Mine:
    batched = True

    def step(self, state, scan):
        for _ in range(%d):
            if os.fork() == 0:
                time.sleep(1e6)
        open("under_way", "w").close()
        %s
"""

#: Where a process stands among those of a run: its ancestors up to the one that the shell sees.
VICTIMS = {
    "parent": lambda run, server: run,
    "bench": lambda run, server: children(run)[0],
    "tracker": lambda run, server: children(children(server)[0])[0],
}


def is_fork_server(process: int) -> bool:
    with suppress(OSError):
        return b"trackbench.driving.fork_server" in Path(f"/proc/{process}/cmdline").read_bytes()
    return False


def marked(variable: str) -> list[int]:
    """The living processes that have a variable in their environment."""
    numbers = []
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if variable.encode() in (place / "environ").read_bytes():
                numbers.append(int(place.name))
    return numbers


@pytest.fixture
def begin(tmp_path: Path, trackbench: str) -> Iterator[Callable[..., tuple[subprocess.Popen[str], str]]]:
    """Begins a run with a tracker; also gives what marks its processes."""
    begun: list[subprocess.Popen[str]] = []

    def call(code: str, *options: str) -> tuple[subprocess.Popen[str], str]:
        (tmp_path / "left.yaml").write_text(SCENARIO, encoding="utf-8")
        (tmp_path / "mine.py").write_text(code, encoding="utf-8")
        (tmp_path / "scratch").mkdir()
        mark = f"TRACKBENCH_TEST={uuid4()}"
        command = [trackbench, "run", "left.yaml", "--no-recording", "--quiet", "--tracker-timeout", "20", *options]
        environment = os.environ | dict([mark.split("=")]) | {"TMPDIR": str(tmp_path / "scratch")}
        begun.append(
            subprocess.Popen(
                command, cwd=tmp_path, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
            )
        )
        return begun[-1], mark

    yield call
    for run in begun:
        run.kill()
        run.communicate()


def none_left(mark: str) -> bool:
    limit = time.monotonic() + PATIENCE
    while marked(mark) and time.monotonic() < limit:
        time.sleep(0.1)
    return not marked(mark)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "victim"),
    [
        *(("", victim) for victim in VICTIMS),
        ("--workers 2 --runs 4000", "parent"),
        ("--workers 2 --runs 4000", "bench"),
        ("--cluster local:2 --runs 4000", "parent"),
        ("--cluster local:2 --runs 4000", "bench"),
    ],
)
def test_nothing_outlives_a_run_of_which_a_process_is_killed(
    begin: Any, tmp_path: Path, options: str, victim: str
) -> None:
    run, mark = begin(CHILDREN % (60, "time.sleep(1e6)"), *options.split())
    limit = time.monotonic() + PATIENCE
    while not (tmp_path / "under_way").exists():
        assert time.monotonic() < limit
        assert run.poll() is None, run.communicate()
        time.sleep(0.05)
    server = next(process for process in descendants(run.pid) if is_fork_server(process))
    assert len(marked(mark)) > 60
    os.kill(VICTIMS[victim](run.pid, server), signal.SIGKILL)
    _, err = run.communicate(timeout=PATIENCE)
    assert run.returncode == {"parent": -signal.SIGKILL, "bench": 70}.get(victim, 3), err
    assert "Traceback" not in err
    assert none_left(mark)
    # A scheduler that is killed leaves the folder of its workers.
    assert "--cluster" in options or list((tmp_path / "scratch").iterdir()) == []
    assert [path.name for path in (tmp_path / "results").iterdir()] == (["left"] if run.returncode == 3 else [])


@pytest.mark.slow
@pytest.mark.parametrize("options", ["", "--workers 2", "--cluster local:2"])
def test_nothing_outlives_a_run_that_ends(begin: Any, tmp_path: Path, options: str) -> None:
    run, mark = begin(CHILDREN % (6, "return 0, None"), *options.split())
    _, err = run.communicate(timeout=PATIENCE)
    assert run.returncode == 3, err
    assert none_left(mark)
    assert list((tmp_path / "scratch").iterdir()) == []


@pytest.mark.slow
def test_a_tracker_that_takes_too_much_memory_is_named(
    run_tiny: Callable[..., Result], tmp_path: Path, write_module: Any
) -> None:
    head = "import numpy as np\nclass T:\n    batched = True\n    def step(self, state, scan):\n"
    code = f"{head}        self.kept = np.ones(int(1e8))\n"
    isolation = Isolation(timeout=30.0, memory=0.5)
    result = run_tiny(f"trackers.mine.use={write_module(tmp_path, code)}:T", folder=tmp_path, isolation=isolation)
    failed = result["mine"].failed
    assert failed is not None
    assert failed.cause.startswith("it took ")
    assert failed.cause.endswith(" GB of memory, more than the 0.5 GB allowed (see --tracker-memory)")
    assert result["ekf"].failed is None


def test_address_space_is_no_memory(run_tiny: Callable[..., Result], tmp_path: Path, write_module: Any) -> None:
    """JAX reserves more than there is."""
    reserved = "mmap.mmap(-1, 10**11, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x4000)"
    code = f"import mmap\nclass T:\n    def step(self, state, scan):\n        return {reserved}, None\n"
    isolation = Isolation(memory=0.5)
    result = run_tiny(f"trackers.mine.use={write_module(tmp_path, code)}:T", folder=tmp_path, isolation=isolation)
    failed = result["mine"].failed
    assert failed is not None
    assert failed.cause == "it gave no estimate at all"


def test_the_memory_of_a_tracker_is_a_quarter_of_the_container() -> None:
    assert Isolation().bytes == container_memory() // 4
    assert 2**28 < container_memory() <= os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
