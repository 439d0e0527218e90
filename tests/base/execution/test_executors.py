"""The same result in this process and in several, many things at once, and what is sent between processes."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import loky
import pytest
import threadpoolctl
from tests.base.execution.results import without_times

from trackbench.api.plan import Listener, RunPlan
from trackbench.api.prepare import prepare
from trackbench.api.run import run_scenarios
from trackbench.base import execution
from trackbench.base.errors import TrackbenchError
from trackbench.base.execution import Executor, executor
from trackbench.base.notebook_classes import dumps
from trackbench.base.plugins import searched
from trackbench.runner.run import run_scenario
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truths_of

Write = Callable[..., Scenario]
#: Loky tells the status where the worker has ended before it looks.
DIED = r"^no result: the process of a worker ended( \(EXIT\(7\)\))?, perhaps by a plug-in"


def test_two_processes_give_the_same_bits(line: Scenario) -> None:
    truths = truths_of(line)
    with executor(2) as two:
        assert without_times(run_scenario(line, truths, executor=two)) == without_times(run_scenario(line, truths))


def test_a_worker_that_dies_ends_the_run_with_one_message() -> None:
    begin = time.monotonic()
    with executor(2) as two, pytest.raises(TrackbenchError, match=DIED) as raised:
        list(two.map(os._exit, [(7,), (0,)]))
    assert len(str(raised.value).splitlines()) == 1
    assert time.monotonic() - begin < 30


def test_a_run_that_takes_long_is_made_by_others_too(line: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(execution, "ALONE_S", 0.0)
    monkeypatch.setattr(loky, "cpu_count", lambda: 2)
    others = set(multiprocessing.active_children())
    seen: list[int] = []
    truths = truths_of(line)
    with executor(None) as shared:
        found = run_scenario(line, truths, executor=shared, progress=lambda *_: seen.append(len(workers() - others)))
    assert max(seen) == 2
    assert without_times(found) == without_times(run_scenario(line, truths))
    assert workers() == others


def workers() -> set[Any]:
    return set(multiprocessing.active_children())


class Ordered(Executor):
    """Notes what is asked for, and what is done."""

    def __init__(self) -> None:
        super().__init__()
        self.events: list[str] = []

    def map(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], *others: Any) -> Iterator[Any]:
        calls = [*calls]
        self.events += [f"asked for {function.__name__}"] * len(calls)

        def noted(*args: Any) -> Any:
            self.events.append(function.__name__)
            return function(*args)

        return super().map(noted, calls, *others)


HIGHWAY = "truth={source: highway-env, env: u-turn-v1, duration_s: 1, rate_hz: 10, seeds: 2}"


def test_the_truths_of_all_scenes_and_scenarios_are_made_at_once(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    ordered = Ordered()
    scenarios = [
        write(name, HIGHWAY, f"truth.rate_hz={rate}", "score.settle_s=0") for name, rate in (("one", 10), ("two", 20))
    ]
    prepare(scenarios, RunPlan(), ordered, Listener())
    assert ordered.events == ["asked for _load"] * 4 + ["_load"] * 4


@pytest.mark.parametrize("cluster", [None, "local:2"])
def test_the_blocks_of_several_scenarios_are_made_at_once(write: Write, cluster: str | None) -> None:
    ordered = Ordered()
    plan = RunPlan(workers=1 if cluster else 2, cluster=cluster)
    scenarios = [write(name, "monte_carlo.runs=2") for name in ("one", "two", "three")]
    found = run_scenarios(scenarios, plan, ordered, Listener())
    assert ordered.events == ["asked for run_blocks"] * 3 + ["run_blocks"] * 3
    assert [result.summary.scenario.name for result in found] == ["one", "two", "three"]


def speak(constant: list[int], number: int, tell: Callable[[int], None] = print) -> tuple[int, list[int]]:
    """What a call can see of where it runs."""
    tell(number)
    return number + sum(constant), [library["num_threads"] for library in threadpoolctl.threadpool_info()]


def test_blas_takes_one_thread_here_and_in_workers() -> None:
    for workers in (1, 2):
        with threadpoolctl.threadpool_limits(2, user_api="blas"), executor(workers) as chosen:
            ((_, threads),) = chosen.map(speak, [([], 0)])
            assert threads
            assert set(threads) == {1}
            assert {library["num_threads"] for library in threadpoolctl.threadpool_info()} == {1}


def test_a_module_that_a_worker_does_not_have_is_named(tmp_path: Path) -> None:
    (tmp_path / "only_here.py").write_text("class Answer: pass\n", encoding="utf-8")
    with searched(tmp_path):
        answer = importlib.import_module("only_here").Answer()
    with executor(2) as two, pytest.raises(TrackbenchError, match="No module named 'only_here'"):
        list(two.map(str, [(answer,)]))
    with executor(2) as two:
        assert "only_here.Answer" in next(two.map(str, [(answer,)], tmp_path))


def test_what_cannot_be_pickled_is_made_in_this_process() -> None:
    lock = threading.Lock()
    with executor(2) as two:
        assert [*two.map(_process_of, [(lock,), (lock,)])] == [os.getpid()] * 2
        assert os.getpid() not in two.map(_process_of, [(None,), (None,)])


def _process_of(_: Any) -> int:
    return os.getpid()


def test_another_command_loads_a_changed_module_anew(tmp_path: Path) -> None:
    """As in a worker of a cluster, which outlives commands."""
    code = "from trackbench.base.notebook_classes import dumps; import changing; from pathlib import Path\n"
    code += "Path('content').write_bytes(dumps((str, changing.Answer())))"
    for command, answer in enumerate(("one", "another")):
        text = f"class Answer:\n    def __str__(self):\n        return {answer!r}\n"
        (tmp_path / "changing.py").write_text(text, encoding="utf-8")
        subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
        content = (tmp_path / "content").read_bytes()
        for _ in range(2):
            assert execution._make_call(content, dumps(()), (tmp_path,), str(command)) == answer
    del sys.modules["changing"]
