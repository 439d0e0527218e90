"""A Dask cluster of real processes."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import distributed
import pytest
from tests.base.execution.results import without_times

from trackbench.base import execution
from trackbench.base.errors import InputError
from trackbench.base.execution import executor
from trackbench.runner.run import run_scenario
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truths_of

Start = Callable[[str], subprocess.Popen[bytes]]
ONE_WORKER = ("dask_worker", "--no-nanny", "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1")
SCHEDULER = ("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")


@pytest.fixture
def started(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The address of a scheduler, and its two workers."""
    file = tmp_path / "scheduler.json"
    processes: list[subprocess.Popen[bytes]] = []

    def start(program: str, *options: str) -> None:
        command = [sys.executable, "-m", f"distributed.cli.{program}", "--scheduler-file", str(file), *options]
        processes.append(subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL))

    try:
        start(*SCHEDULER)
        limit = time.monotonic() + 60
        while not file.is_file() or not file.read_text(encoding="utf-8"):
            assert time.monotonic() < limit
            time.sleep(0.05)
        for _ in range(2):
            start(*ONE_WORKER, "--local-directory", str(tmp_path))
        yield json.loads(file.read_text(encoding="utf-8"))["address"], processes[1:]
    finally:
        for process in processes[::-1]:
            process.kill()
            process.wait()


def test_a_cluster_of_which_a_worker_is_killed_gives_the_same_bits(
    line: Scenario, started: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, workers = started
    truths = truths_of(line)
    alive: list[int] = []

    def kill(done: float, total: float) -> None:
        """One of the two, once the first block is done."""
        if workers[0].poll() is None:
            alive.append(round(done))
            workers[0].kill()
            workers[0].wait()

    with executor(cluster=address) as cluster:
        client = distributed.default_client()
        client.wait_for_workers(2)
        found = run_scenario(line, truths, executor=cluster, progress=kill)
        assert len(client.scheduler_info()["workers"]) == 1
    assert alive == [2], "killed with ten of twelve blocks to do"
    assert without_times(found) == without_times(run_scenario(line, truths))


def test_a_cluster_of_this_machine_gives_the_same_bits_and_leaves_no_process(line: Scenario) -> None:
    truths = truths_of(line)
    with executor(cluster="local:2") as cluster:
        found = run_scenario(line, truths, executor=cluster)
    assert without_times(found) == without_times(run_scenario(line, truths))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--cluster", "here"], "--cluster: write tcp://HOST:PORT or local:4, not 'here'\n"),
        (["--cluster", "local:0"], "--cluster: write tcp://HOST:PORT or local:4, not 'local:0'\n"),
        (
            ["--cluster", "tcp://127.0.0.1:9"],
            "--cluster: no Dask scheduler with workers answers at tcp://127.0.0.1:9\n",
        ),
        (
            ["--cluster", "local:2", "--workers", "2"],
            "workers: give workers or a cluster, not both: leave one of them out\n",
        ),
    ],
)
def test_a_cluster_that_cannot_be_had_is_one_message(
    cli: Callable[..., Any], tiny: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], message: str
) -> None:
    monkeypatch.setattr(execution, "PATIENCE_S", 1)
    done = cli("run", "tiny.yaml", *options)
    assert (done.status, done.out, done.err) == (2, "", message)


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError) as caught, executor(cluster="local:2"):
        pass
    assert str(caught.value) == '--cluster: needs Dask, which is not installed: pip install "trackbench[cluster]"'
