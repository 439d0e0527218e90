"""Work on a Dask cluster. The only importer of distributed."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import partial
from typing import Any

from trackbench.errors import InputError, TrackbenchError
from trackbench.execution.task import Task
from trackbench.interruption import uninterrupted

try:
    import dask
    import distributed
    from distributed.scheduler import KilledWorker
except ImportError as missing:
    raise InputError(
        'needs Dask, which is not installed: pip install "trackbench[cluster]"', key="--cluster"
    ) from missing

#: How long a scheduler or its workers may take to answer, s.
PATIENCE = 10
#: How long a worker that is told to end may take, s.
FAREWELL = 1
LOCAL = re.compile(r"local:([1-9]\d{0,3})")
REMOTE = re.compile(r"(tcp|tls|ucx|ws|wss)://.+:\d+")
SETTINGS = {
    # A scene of random motion may be large; it is sent once to each worker.
    "distributed.admin.large-graph-warning-threshold": "1TB",
    "distributed.comm.timeouts.connect": f"{PATIENCE}s",
}
DIED = "workers of the cluster died several times of the same work; --workers 1 may show what they died of"
LOST = "the connection to the Dask scheduler was lost"


class Cluster(Executor):
    """The workers of a Dask cluster; the scheduler gives to others what one that dies leaves undone.

    Args:
        address: of the scheduler.
        client: connected to it.
        local: the cluster of this machine that ends with the executor, if it is one.
    """

    def __init__(self, address: str, client: distributed.Client, local: distributed.LocalCluster | None = None) -> None:
        self._address, self._client, self._local = address, client, local
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
        self._executor.submit(_call, sent, *args, **kwargs).add_done_callback(partial(_pass_on, outcome))
        return outcome

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take back what is not done, and let the cluster go."""
        self._executor.shutdown(wait=False)
        self._sent.clear()
        _close(self._client)
        if self._local is not None:
            _close(self._local)

    def __str__(self) -> str:
        workers = self._client.scheduler_info()["workers"]
        return f"on the Dask cluster {self._address} ({len(workers)} workers)"


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
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    local = None
    with uninterrupted():
        if here is not None:
            local = distributed.LocalCluster(
                n_workers=int(here[1]),
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address=None,
                memory_limit=0,
                silence_logs=logging.CRITICAL,
            )
        try:
            client = distributed.Client(local or address, timeout=PATIENCE)
        except OSError as error:
            raise InputError(f"no Dask scheduler answers at {address}", key="--cluster") from error
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError as error:
        _close(client)
        raise InputError(f"the Dask scheduler at {address} has no workers", key="--cluster") from error
    return Cluster(address, client, local)


def _close(connection: distributed.Client | distributed.LocalCluster) -> None:
    with suppress(TimeoutError):
        connection.close(timeout=FAREWELL)


def _pass_on(outcome: Future[Any], future: Future[Any]) -> None:
    if future.cancelled():
        outcome.set_exception(TrackbenchError(LOST))
    elif isinstance(future.exception(), KilledWorker):
        outcome.set_exception(TrackbenchError(DIED))
    elif future.exception() is not None:
        outcome.set_exception(future.exception())
    else:
        outcome.set_result(future.result())


def _same(task: Callable[..., Any]) -> Callable[..., Any]:
    return task


def _call(task: Callable[..., Any], *args: Any) -> Any:
    return task(*args)
