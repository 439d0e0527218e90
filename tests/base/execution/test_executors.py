"""The same result in this process and in several, many things at once, and what is sent between processes."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import loky
import pytest
import threadpoolctl
from tests.base.execution.results import without_times

from trackbench.api.plan import Listener, RunPlan
from trackbench.api.prepare import prepare
from trackbench.api.run import run_prepared as run_all
from trackbench.base.errors import TrackbenchError
from trackbench.base.execution import Here, InProcess, Shared, Task, executor, one_blas_thread, task
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.truth import truths_of

Write = Callable[..., Scenario]


def test_two_processes_give_the_same_bits(line: Scenario) -> None:
    truths = truths_of(line)
    with executor(2) as two:
        assert without_times(run_scenario(line, truths, executor=two)) == without_times(run_scenario(line, truths))


def test_there_are_no_more_workers_than_pieces_of_work() -> None:
    others = workers()
    with executor(64) as many:
        assert workers() == others
        for number in (1, 3):
            calls = [many.submit(time.sleep, 2) for _ in range(number)]
            assert len(workers() - others) == number
            for call in calls:
                call.result()
        most = [many.submit(os.getpid) for _ in range(3)]
        assert {call.result() for call in most} <= {process.pid for process in workers() - others}
        assert len(workers() - others) == 3
    assert workers() == others


def test_a_killed_worker_changes_nothing(line: Scenario) -> None:
    others = set(multiprocessing.active_children())
    killed: list[int] = []

    def kill(done: float, total: float) -> None:
        """One of the two, once the first block is done."""
        if not killed:
            (first, _) = sorted(set(multiprocessing.active_children()) - others, key=lambda process: process.pid or 0)
            assert first.pid is not None
            os.kill(first.pid, signal.SIGKILL)
            killed.append(first.pid)

    truths = truths_of(line)
    with executor(2) as two:
        found = run_scenario(line, truths, executor=two, progress=kill)
    assert killed
    assert without_times(found) == without_times(run_scenario(line, truths))
    assert set(multiprocessing.active_children()) == others


def test_workers_that_die_again_end_the_run_with_a_message() -> None:
    with executor(2) as two:
        futures = [two.submit(os._exit, 7) for _ in range(3)]
        for future in futures:
            with pytest.raises(
                TrackbenchError,
                match=r"^no result: a second worker has ended: its process ended itself, with status 7$",
            ):
                future.result()


def test_a_run_that_takes_long_is_made_by_others_too(line: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "ALONE", 0.0)
    monkeypatch.setattr(loky, "cpu_count", lambda: 2)
    others = set(multiprocessing.active_children())
    seen: list[int] = []
    truths = truths_of(line)
    with executor(None) as shared:
        found = run_scenario(line, truths, executor=shared, progress=lambda *_: seen.append(len(workers() - others)))
    assert max(seen) == 1
    assert without_times(found) == without_times(run_scenario(line, truths))
    assert workers() == others


def workers() -> set[Any]:
    return set(multiprocessing.active_children())


def test_a_short_run_is_made_in_this_process(line: Scenario) -> None:
    before = workers()
    with executor(None) as shared:
        run_scenario(load_scenario(line.path, ["monte_carlo.runs=4"]), truths_of(line), executor=shared)
        assert workers() == before


def test_on_one_core_nobody_helps(line: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "ALONE", 0.0)
    monkeypatch.setattr(loky, "cpu_count", lambda: 1)
    before = workers()
    with executor(None) as shared:
        run_scenario(line, truths_of(line), executor=shared)
        assert workers() == before


class Threads(Executor):
    """One thread that says that it has a call, and waits for leave."""

    def __init__(self, taken: Event, leave: Event) -> None:
        self._taken, self._leave, self._pool = taken, leave, ThreadPoolExecutor(1)

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        def later() -> Any:
            self._taken.set()
            assert self._leave.wait(10)
            return f"elsewhere {call()}"

        return self._pool.submit(later)


def test_whoever_is_free_makes_the_next_call() -> None:
    begun, taken, leave = Event(), Event(), Event()

    def start() -> tuple[Executor, int]:
        assert begun.wait(10)
        return Threads(taken, leave), 1

    def first() -> str:
        begun.set()
        assert taken.wait(10)
        return "0"

    shared = Shared(start)
    futures = [shared.submit(Task(lambda *_: first(), None, None, long=True))]
    futures += [shared.submit(str, number) for number in range(1, 4)]
    assert futures[0].result() == "0"
    # The other one is at the next call and this process waits for it: it makes those after it meanwhile.
    threading.Timer(0.2, leave.set).start()
    assert futures[1].result() == "elsewhere 1"
    assert [future.result() for future in futures[2:]] == ["2", "3"]
    shared.shutdown()


def test_nothing_more_is_made_once_the_work_has_ended() -> None:
    taken, leave = Event(), Event()
    made: list[int] = []
    shared = Shared(lambda: (Threads(taken, leave), 1))
    shared.submit(Task(speak, [], None, long=True), 0, Here(made.append))
    assert taken.wait(10)
    later = [shared.submit(Task(speak, [], None), number, Here(made.append)) for number in (1, 2)]
    shared.shutdown()
    leave.set()
    time.sleep(0.2)
    assert not any(future.done() for future in later)
    assert made in ([], [0])


def test_what_cannot_be_sent_is_made_here() -> None:
    begun = Event()

    def start() -> tuple[Executor, int]:
        begun.set()
        return Threads(Event(), Event()), 1

    shared = Shared(start)
    futures = [shared.submit(Task(lambda _, number: number, None, None, long=True), number) for number in range(2)]
    assert begun.wait(10)
    assert [future.result() for future in futures] == [0, 1]
    shared.shutdown()


def test_where_no_other_process_can_be_started_this_one_does_all() -> None:
    def start() -> tuple[Executor, int]:
        raise OSError("no more processes")

    shared = Shared(start)
    futures = [shared.submit(Task(lambda _, number: number, None, None, long=True), number) for number in range(3)]
    assert [future.result() for future in futures] == [0, 1, 2]
    with pytest.raises(ZeroDivisionError):
        shared.submit(lambda: 1 // 0).result()
    shared.shutdown()


class Ordered(Executor):
    """Notes what is asked for, and what is done."""

    def __init__(self) -> None:
        self.events: list[str] = []
        self._executor = InProcess()

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        assert isinstance(call, Task)
        name = call._function.__name__
        self.events.append(f"asked for {name}")

        def noted() -> Any:
            self.events.append(name)
            return call(*args, **kwargs)

        return self._executor.submit(noted)


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
    assert ordered.events == ["asked for made"] * 4 + ["made"] * 4


@pytest.mark.parametrize("cluster", [None, "local:2"])
def test_the_blocks_of_several_scenarios_are_made_at_once(write: Write, cluster: str | None) -> None:
    ordered = Ordered()
    plan = RunPlan(workers=1 if cluster else 2, cluster=cluster)
    scenarios = [write(name, "monte_carlo.runs=2") for name in ("one", "two", "three")]
    found = run_all(prepare(scenarios, plan, ordered, Listener()), plan, ordered, Listener())
    assert ordered.events == ["asked for run_blocks"] * 3 + ["run_blocks"] * 3
    assert [result.summary.scenario.name for result in found] == ["one", "two", "three"]


def folders(where: Path) -> dict[str, bytes]:
    return {str(file.relative_to(where)): file.read_bytes() for file in where.rglob("report.html")}


def test_folders_are_written_while_others_are_computed(write: Write, tmp_path: Path) -> None:
    scenarios = [write(name, "monte_carlo.runs=2") for name in ("one", "two", "three")]
    ordered = Ordered()
    told: list[str] = []

    class Told(Listener):
        def end(self, result: Result, folder: Path | None) -> None:
            assert folder is not None
            assert (folder / "report.html").is_file()
            told.append(result.summary.scenario.name)

    plan = RunPlan(tmp_path / "out", workers=2, left_out=frozenset({"recording.rrd"}))
    run_all(prepare(scenarios, plan, ordered, Told()), plan, ordered, Told())
    assert told == ["one", "two", "three"]
    last_block = len(ordered.events) - ordered.events[::-1].index("run_blocks")
    assert ordered.events.index("asked for pages") < last_block
    assert (tmp_path / "out" / "comparison.html").is_file()


def speak(constant: list[int], number: int, tell: Callable[[int], None]) -> tuple[int, list[int]]:
    """What a task can see of where it runs."""
    print("a task speaks")
    tell(number)
    return number + sum(constant), [library["num_threads"] for library in threadpoolctl.threadpool_info()]


def test_a_sent_task_prints_to_stderr_and_tells_nobody(capfd: pytest.CaptureFixture[str]) -> None:
    told: list[int] = []
    task = Task(speak, [1, 2], None)
    assert task(3, Here(told.append))[0] == 6
    assert (told, capfd.readouterr()) == ([3], ("a task speaks\n", ""))
    sent, tell = pickle.loads(pickle.dumps((task, Here(told.append))))
    found = pickle.loads(pickle.dumps(sent(3, tell)))
    assert found[0] == 6
    assert (told, capfd.readouterr()) == ([3], ("", "a task speaks\n"))


def test_blas_takes_one_thread_here_and_in_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    for workers in (1, 2):
        with threadpoolctl.threadpool_limits(2, user_api="blas"), executor(workers) as chosen:
            _, threads = chosen.submit(Task(speak, [], None), 0, Here(print)).result()
            assert threads
            assert set(threads) == {1}
            assert {library["num_threads"] for library in threadpoolctl.threadpool_info()} == {1}


def test_the_thread_limit_ends_with_the_command() -> None:
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        with one_blas_thread(), one_blas_thread():
            pass
        assert {library["num_threads"] for library in threadpoolctl.threadpool_info()} == {2}


def test_a_folder_that_a_worker_does_not_have_is_named(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    content = pickle.dumps(Task(speak, [], tmp_path / "there"))
    (tmp_path / "there").rmdir()
    with pytest.raises(TrackbenchError, match=f"there is no folder {tmp_path / 'there'}, which has modules of the sc"):
        pickle.loads(content)(0, print)


def test_a_changed_module_is_loaded_anew_by_the_next_task(tmp_path: Path) -> None:
    """As in a worker that outlives a command."""
    code = "import pickle; from pathlib import Path; from trackbench.base.execution import Task; import changing\n"
    code += "Path('task').write_bytes(pickle.dumps(Task(str, changing.Answer(), Path.cwd())))"
    for answer in ("one", "another"):
        text = f"class Answer:\n    def __str__(self):\n        return {answer!r}\n"
        (tmp_path / "changing.py").write_text(text, encoding="utf-8")
        subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
        sent = pickle.loads((tmp_path / "task").read_bytes())
        assert pickle.loads(pickle.dumps(sent())) == answer
    assert "changing" not in sys.modules
