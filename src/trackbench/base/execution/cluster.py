"""Work on a Dask cluster. The only importer of distributed."""

from __future__ import annotations

import logging
import operator
import os
import re
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future, InvalidStateError
from contextlib import ExitStack, suppress
from functools import partial
from tempfile import TemporaryDirectory
from threading import Event, Lock, Thread
from typing import Any

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.execution.task import MOST_WORKERS, Task, uninterrupted
from trackbench.base.exit_status import how_it_ended

try:
    import dask
    import distributed
    from distributed.scheduler import KilledWorker
except ImportError as missing:
    raise InputError(
        'needs Dask, which is not installed: pip install "trackbench[cluster]"', key="--cluster"
    ) from missing

#: How long a scheduler or its workers may take to answer, s.
PATIENCE = 20
#: How long a worker that is told to end may take, s.
FAREWELL = 1
#: Between two looks whether the workers of this machine are there, s.
INTERVAL = 0.2
LOCAL = re.compile(r"local:([0-9]{1,4000})")
REMOTE = re.compile(r"(tcp|tls|ucx|ws|wss)://.+:[0-9]{1,5}")
SETTINGS = {
    # A scene of random motion may be large; it is sent once to each worker.
    "distributed.admin.large-graph-warning-threshold": "1TB",
    "distributed.comm.timeouts.connect": f"{PATIENCE}s",
}
#: The log of a worker on this machine, which would stand among the messages of the run.
QUIET = {"DASK_LOGGING__DISTRIBUTED": "critical"}
#: Of the workers of this machine so many may end, whose work the others take over.
MOST_ENDED = 1
DIED = "workers of the cluster died several times of the same work; --workers 1 may show what they died of"
LOST = "the connection to the Dask scheduler was lost"


class Cluster(Executor):
    """The workers of a Dask cluster; the scheduler gives to others what one that dies leaves undone.

    Args:
        address: of the scheduler, as the user wrote it.
        client: connected to it.
        started: what was started for it, and ends with it.
        local: the workers of this machine, if it is a cluster of this machine.
    """

    def __init__(
        self,
        address: str,
        client: distributed.Client,
        started: ExitStack,
        local: LocalWorkers | None = None,
    ) -> None:
        self._address, self._client, self._started, self._local = address, client, started, local
        self._pending: set[Future[Any]] = set()
        self._failure: TrackbenchError | None = None
        self._closing = Event()
        if local is not None:
            Thread(target=self._watch, args=(local,), daemon=True).start()
        self._executor = client.get_executor(pure=False)
        self._sent: dict[int, tuple[Task, distributed.Future[Any]]] = {}

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future of the call; a task is sent once to each worker that makes one of its calls."""
        sent: Any = call
        if isinstance(call, Task):
            if id(call) not in self._sent:
                self._sent[id(call)] = call, self._client.submit(_same, call, pure=False)
            sent = self._sent[id(call)][1]
        outcome: Future[Any] = Future()
        self._pending.add(outcome)
        outcome.add_done_callback(self._pending.discard)
        future = self._executor.submit(operator.call, sent, *args, **kwargs)
        future.add_done_callback(partial(_pass_on, outcome))
        if self._failure is not None:
            _fail(outcome, self._failure)
        return outcome

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take back what is not done, and let the cluster go."""
        self._closing.set()
        self._executor.shutdown(wait=False)
        self._sent.clear()
        self._started.close()

    def __str__(self) -> str:
        number = len(self._client.scheduler_info()["workers"]) if self._local is None else self._local.most
        return f"on the Dask cluster {self._address} ({number} workers)"

    def _watch(self, local: LocalWorkers) -> None:
        """Start workers for the pending calls; fail all that is not done once too many workers have ended."""
        while not self._closing.wait(INTERVAL):
            failure = local.staff(len(self._pending))
            if failure is not None:
                self._failure = TrackbenchError(failure)
                for outcome in list(self._pending):
                    _fail(outcome, self._failure)
                return


class LocalWorkers:
    """Workers on this machine: no more than there are pieces of work.

    Args:
        scheduler: its address.
        scratch: folder in which they keep their files.
        most: number of workers at most.
    """

    def __init__(self, scheduler: str, scratch: str, most: int) -> None:
        self.most, self._scheduler, self._scratch = most, scheduler, scratch
        self._workers: list[subprocess.Popen[bytes]] = []
        self._lock, self._closed = Lock(), False

    def staff(self, calls: int) -> str | None:
        """Start the workers that are missing; return what is wrong where too many have ended.

        Args:
            calls: number of those that have not ended.
        """
        ended = [worker for worker in self._workers if worker.poll() is not None]
        if len(ended) > min(MOST_ENDED, self.most - 1):
            how = how_it_ended(ended[-1].returncode)
            return f"no result: {len(ended)} of {self.most} workers have ended: {how}"
        for _ in range(len(self._workers) - len(ended), min(self.most, calls)):
            with self._lock:
                if not self._closed:
                    self._workers.append(_start_worker(self._scheduler, self._scratch))
        return None

    def close(self) -> None:
        """Kill them."""
        with self._lock:
            self._closed = True
        for worker in self._workers:
            worker.kill()
            worker.wait()


def connected(address: str) -> Cluster:
    """The cluster at an address.

    Args:
        address: ``tcp://HOST:PORT`` of a scheduler, or ``local:N`` for N workers on this machine.

    Raises:
        InputError: it is no such address, or no scheduler or no worker answers there.
    """
    here = LOCAL.fullmatch(address)
    if here is None and REMOTE.fullmatch(address) is None:
        raise InputError(f"write tcp://HOST:PORT or local:4, not {address!r}", key="--cluster")
    dask.config.set(SETTINGS)
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        local = None
        if here is not None:
            if not 1 <= int(here[1]) <= MOST_WORKERS:
                raise InputError(f"write local:1 to local:{MOST_WORKERS}, not {address!r}", key="--cluster")
            scratch = stack.enter_context(TemporaryDirectory(prefix="trackbench-", ignore_cleanup_errors=True))
            scheduler = distributed.LocalCluster(
                n_workers=0,
                host="127.0.0.1",
                silence_logs=logging.CRITICAL,
                # Its server of pages listens also without a dashboard, at a port that another run may have.
                scheduler_kwargs={"local_directory": scratch, "dashboard_address": "127.0.0.1:0", "dashboard": False},
            )
            stack.callback(_close, scheduler)
            local = LocalWorkers(scheduler.scheduler_address, scratch, int(here[1]))
            stack.callback(local.close)
        try:
            client = distributed.Client(address if here is None else scheduler.scheduler_address, timeout=PATIENCE)
            stack.callback(_close, client)
            if here is None:
                client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError as error:
            raise InputError(f"no Dask scheduler with workers answers at {address}", key="--cluster") from error
        except OSError as error:
            raise InputError(f"no Dask scheduler answers at {address}", key="--cluster") from error
        return Cluster(address, client, stack.pop_all(), local)


def _start_worker(address: str, scratch: str) -> subprocess.Popen[bytes]:
    """A worker on this machine; it ends when the scheduler does, or when it is killed.

    It is a plain process, since Dask's nanny takes seconds to end one.
    """
    options = ["--no-nanny", "--nthreads", "1", "--memory-limit", "0", "--no-dashboard", "--host", "127.0.0.1"]
    options += ["--local-directory", scratch]
    command = [sys.executable, "-m", "distributed.cli.dask_worker", address, *options]
    with uninterrupted():
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=2, env={**os.environ, **QUIET})


def _close(connection: distributed.Client | distributed.LocalCluster) -> None:
    with suppress(TimeoutError):
        connection.close(timeout=FAREWELL)


def _pass_on(outcome: Future[Any], future: Future[Any]) -> None:
    if future.cancelled():
        _fail(outcome, TrackbenchError(LOST))
    elif isinstance(future.exception(), KilledWorker):
        _fail(outcome, TrackbenchError(DIED))
    elif (error := future.exception()) is not None:
        _fail(outcome, error)
    else:
        with suppress(InvalidStateError):
            outcome.set_result(future.result())


def _fail(outcome: Future[Any], error: BaseException) -> None:
    # It may have failed already.
    with suppress(InvalidStateError):
        outcome.set_exception(error)


def _same(task: Callable[..., Any]) -> Callable[..., Any]:
    return task
