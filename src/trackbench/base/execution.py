"""Execution of a command's work in this process, in several of this machine (loky), or on a Dask cluster."""

from __future__ import annotations

import logging
import os
import re
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Future
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from itertools import starmap
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from uuid import uuid4

from trackbench.base import notebook_classes
from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.plugins import one_line, searched
from trackbench.base.user_code import place_of

log = logging.getLogger(__name__)

#: Largest number of processes on one machine.
MOST_WORKERS = 1024
#: Time after which work moves from this process to others, which take a second to start, s.
ALONE_S = 1.0
#: Longest time that a Dask scheduler may take to answer, s.
PATIENCE_S = 20
# A worker of a cluster may have several threads, which share the module path.
_ONE_CALL = threading.Lock()
Submit = Callable[..., Future[Any]]


class Executor:
    """Executor of function calls, in this process and, if ``start`` is given, also in other processes.

    Args:
        start: function that starts other processes and returns loky's or Dask's ``submit``; None for no others.
        alone_s: time for which this process works alone before other processes are started, s.
    """

    def __init__(self, start: Callable[[], Submit] | None = None, alone_s: float = 0.0) -> None:
        self._start = None if start is None else cache(start)
        self._alone_s, self._busy_s, self._command = alone_s, 0.0, uuid4().hex

    def map(
        self,
        function: Callable[..., Any],
        calls: Iterable[tuple[Any, ...]],
        folder: Path | None = None,
        observers: tuple[Callable[..., None] | None, ...] = (),
    ) -> Iterator[Any]:
        """Yield the result of each call, in the order of the calls.

        Calls in other processes begin at once; a call in this process is made when its result is needed.

        Args:
            function: function of a module that other processes can import.
            calls: arguments of each call. The first argument is pickled once for all calls that share it.
            folder: folder of the modules of the arguments' classes beside the working directory; None if there is none.
            observers: functions that calls in this process get as last arguments, such as for progress; each has a
                default.

        Raises:
            TrackbenchError: another process ended, or a plug-in failed there.
        """
        if self._start is None:
            return starmap(function, [(*call, *observers) for call in calls])
        waiting = deque(calls)
        return self._results(self._send_due(function, waiting, folder), waiting, function, folder, observers)

    def _results(
        self, sent: deque[Future[Any]], waiting: deque[Any], function: Callable[..., Any], folder: Any, observers: Any
    ) -> Iterator[Any]:
        while sent or waiting:
            if sent := sent or self._send_due(function, waiting, folder):
                with _explain_dead_workers():
                    result = sent.popleft().result()
            else:
                begin = time.monotonic()
                result = function(*waiting.popleft(), *observers)
                self._busy_s += time.monotonic() - begin
            yield result

    def _send_due(self, function: Callable[..., Any], waiting: deque[Any], folder: Path | None) -> deque[Future[Any]]:
        if self._start is None or self._busy_s < self._alone_s or not waiting:
            return deque()
        try:
            firsts = {id(call[0]): call[0] for call in waiting}
            contents = {key: notebook_classes.dumps((function, first)) for key, first in firsts.items()}
            packed = [(contents[id(first)], notebook_classes.dumps(rest)) for first, *rest in waiting]
        except Exception as error:
            log.info("the work stays in this process, since it cannot be sent to another one: %s", one_line(error))
            return deque()
        place = (folder, Path.cwd()), self._command
        with _explain_dead_workers():
            submit = self._start()
            sent = deque(submit(_make_call, content, rest, *place) for content, rest in packed)
        waiting.clear()
        return sent


@contextmanager
def _explain_dead_workers() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        if isinstance(error, BrokenExecutor | CancelledError) or type(error).__name__ == "KilledWorker":
            statuses = ", ".join(sorted(set(re.findall(r"[A-Z]+\(-?[1-9][0-9]*\)", str(error)))))
            problem = f"no result: the process of a worker ended{f' ({statuses})' if statuses else ''}"
            raise TrackbenchError(f"{problem}, perhaps by a plug-in or for lack of memory") from error
        raise


def _make_call(content: bytes, rest: bytes, folders: tuple[Path | None, ...], command: str) -> Any:
    with _ONE_CALL, searched(*folders):
        try:
            _forget_modules(folders, command)
            function, first = notebook_classes.loads(content)
            with one_blas_thread():
                return function(first, *notebook_classes.loads(rest))
        except TrackbenchError:
            raise
        except BaseException as error:
            place = place_of(error, installed=False)
            if place is None and isinstance(error, Exception) and not isinstance(error, ImportError):
                raise
            # The traceback is not sent. A SystemExit would end the process that asks for the result.
            where = "" if place is None else f" ({place})"
            raise TrackbenchError(f"a plug-in failed: {one_line(error)}{where}") from None


@cache
def _forget_modules(folders: tuple[Path | None, ...], _command: str) -> None:
    """Remove the modules of ``folders`` from memory once per command: files may change while a worker lives."""
    for name in [*sys.modules]:
        file = getattr(sys.modules.get(name.partition(".")[0]), "__file__", None)
        if file and not name.startswith("trackbench") and not {*folders}.isdisjoint([*Path(file).parents][:2]):
            del sys.modules[name]


@contextmanager
def executor(workers: int | None = 1, cluster: str | None = None) -> Iterator[Executor]:
    """Open an executor for all the work of a command; work that still runs at the end is dropped.

    Args:
        workers: number of processes of this machine; 1 is this process. None: this process and, where the work takes
            long, one process for each core.
        cluster: ``tcp://HOST:PORT`` of a Dask scheduler, or ``local:N`` for one with N workers on this machine.

    Raises:
        InputError: the cluster cannot be reached or Dask is not installed; ``workers`` is no number of processes, or
            is given with a cluster.
    """
    if workers is not None and (type(workers) is not int or not 1 <= workers <= MOST_WORKERS):
        problem = f"{workers!r} is not a number of processes; give a whole number from 1 to {MOST_WORKERS}"
        raise InputError(problem, key="workers")
    if (workers or 1) > 1 and cluster is not None:
        raise InputError("give workers or a cluster, not both: leave one of them out", key="workers")
    with one_blas_thread(), ExitStack() as stack:
        if cluster is not None:
            submit = _connect_cluster(cluster, stack)
            yield Executor(lambda: submit)
        else:
            start = partial(_start_processes, workers, stack)
            yield Executor() if workers == 1 else Executor(start, 0.0 if workers else ALONE_S)


def _start_processes(number: int | None, stack: ExitStack) -> Submit:
    from loky import ProcessPoolExecutor, cpu_count

    # Loky would restart a worker that has grown by 300 MB, which blocks of different sizes cause.
    environment = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e15"}
    pool = ProcessPoolExecutor(
        number or cpu_count(), initializer=_end_with_parent, initargs=(os.getpid(),), env=environment
    )
    stack.callback(pool.shutdown, kill_workers=True)
    submit: Submit = pool.submit
    return submit


def _end_with_parent(parent: int) -> None:
    # Ctrl-C is for the parent.
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _connect_cluster(address: str, stack: ExitStack) -> Submit:
    local = re.fullmatch(r"local:([1-9][0-9]{0,2})", address)
    if local is None and not re.fullmatch(r"[a-z]+://.+:[0-9]{1,5}", address):
        raise InputError(f"write tcp://HOST:PORT or local:4, not {address!r}", key="--cluster")
    try:
        import dask
        import distributed
    except ImportError as missing:
        problem = 'needs Dask, which is not installed: pip install "trackbench[cluster]"'
        raise InputError(problem, key="--cluster") from missing
    dask.config.set({"distributed.scheduler.allowed-failures": 0})
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    at: Any = address
    try:
        if local is not None:
            options = {"threads_per_worker": 1, "memory_limit": 0, "silence_logs": logging.CRITICAL}
            folder = stack.enter_context(TemporaryDirectory())
            stack.enter_context(dask.config.set({"temporary-directory": folder}))
            at = distributed.LocalCluster(int(local[1]), host="127.0.0.1", dashboard_address="127.0.0.1:0", **options)
            stack.enter_context(at)
        client = stack.enter_context(distributed.Client(at, timeout=PATIENCE_S))
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler with workers answers at {address}", key="--cluster") from error
    # Each worker gets shared bytes once.
    submit, shared = client.get_executor(pure=False).submit, cache(client.scatter)
    return lambda function, content, *args: submit(function, shared(content), *args)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread; also a decorator.

    The products of a filter are so small that a second thread costs more than it saves, and many times more where the
    processor is shared.
    """
    # This import takes some 10 ms, and only commands that compute need it.
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
