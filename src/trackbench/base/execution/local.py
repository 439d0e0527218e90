"""Work in several processes of this machine."""

from __future__ import annotations

import gc
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import partial
from typing import Any

from loky import ProcessPoolExecutor, process_executor
from loky.backend import resource_tracker
from loky.process_executor import BrokenProcessPool, TerminatedWorkerError

from trackbench.base.errors import TrackbenchError, printable, text_of
from trackbench.base.execution.task import allow_termination, uninterrupted
from trackbench.base.exit_status import how_it_ended

#: What is said of the second worker that has ended.
DIED = "no result: a second worker has ended: "
#: Between two looks whether the process that started a worker is still there, s.
INTERVAL = 0.5
#: Loky would restart a worker that has grown by 300 MB, as one does whose blocks differ in size.
ENVIRONMENT = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e15"}


class LocalProcesses(Executor):
    """Processes of this machine; what is lost when one of them dies is done once more by fresh ones.

    Args:
        number: of processes at most; there are no more than calls that have not ended.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self._deaths = self._open = 0
        self._failure = TrackbenchError(DIED)
        self._lock = threading.RLock()
        # Loky would also kill what a worker has started, and with it what ends the children of a tracker.
        process_executor.kill_process_tree = _kill
        _start_resource_tracker()
        self._pool = self._new()

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future of the call."""
        outcome: Future[Any] = Future()
        with self._lock:
            self._open += 1
        outcome.add_done_callback(self._ended)
        self._start(outcome, partial(call, *args, **kwargs))
        return outcome

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, whatever they do."""
        self._pool.shutdown(kill_workers=True)

    def __str__(self) -> str:
        return f"in {self._number} processes of this machine" if self._number > 1 else "in another process"

    def _new(self) -> ProcessPoolExecutor:
        # The number decides on the length of the queue too.
        pool = ProcessPoolExecutor(self._number, initializer=_begin, initargs=(os.getpid(),), env=ENVIRONMENT)
        pool._max_workers = 1
        return pool

    def _ended(self, _: Future[Any]) -> None:
        with self._lock:
            self._open -= 1

    def _start(self, outcome: Future[Any], call: Callable[[], Any]) -> None:
        with self._lock:
            pool = self._pool
            try:
                # A call starts the processes that are missing.
                pool._max_workers = max(pool._max_workers, min(self._number, self._open))
                with uninterrupted():
                    future = pool.submit(call)
                    # Loky's thread was woken before they were there, and has to watch them too.
                    with pool._shutdown_lock:
                        pool._executor_manager_thread_wakeup.wakeup()
            except BrokenProcessPool as error:
                self._again(pool, outcome, call, error)
                return
        future.add_done_callback(partial(self._done, pool, outcome, call))

    def _done(
        self, pool: ProcessPoolExecutor, outcome: Future[Any], call: Callable[[], Any], future: Future[Any]
    ) -> None:
        error = future.exception()
        if isinstance(error, BrokenProcessPool):
            self._again(pool, outcome, call, error)
        elif error is not None:
            outcome.set_exception(error)
        else:
            outcome.set_result(future.result())

    def _again(
        self, broken: ProcessPoolExecutor, outcome: Future[Any], call: Callable[[], Any], error: BaseException
    ) -> None:
        with self._lock:
            if self._pool is broken:
                self._deaths += 1
                if self._deaths == 1:
                    self._pool = self._new()
                if self._deaths == 2:
                    self._failure = TrackbenchError(DIED + self._cause(broken, error))
            if self._pool is not broken:
                self._start(outcome, call)
                return
        outcome.set_exception(self._failure)

    def _cause(self, broken: ProcessPoolExecutor, error: BaseException) -> str:
        """How a worker of the broken pool has ended, the others of which still run."""
        for process in list(broken._processes.values()):
            if process.exitcode is not None:
                return how_it_ended(process.exitcode)
        closed = isinstance(error, TerminatedWorkerError)
        return "its process closed its files" if closed else printable(text_of(error))


def _kill(worker: Any) -> None:
    with suppress(ProcessLookupError):
        os.kill(worker.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
    worker.join()


def _start_resource_tracker() -> None:
    """Loky's helper, which removes what a run that is killed leaves behind, without its warning of that."""
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker"
    try:
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


def _begin(parent: int) -> None:
    """In a new process, which ends when that which started it has ended, which no longer reads what it writes."""
    allow_termination()
    gc.set_threshold(500_000, 50, 100)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(INTERVAL)
    os._exit(1)
