"""Where the work of a command runs: in this process, in several of this machine, or on a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from trackbench.base.errors import InputError
from trackbench.base.execution.task import MOST_WORKERS, Here, InProcess, Shared, Task, one_blas_thread

__all__ = ["MOST_WORKERS", "Here", "InProcess", "Task", "executor", "one_blas_thread"]

log = logging.getLogger(__name__)


@contextmanager
def executor(workers: int | None = 1, cluster: str | None = None) -> Iterator[Executor]:
    """An executor for all the work of a command; whatever still runs when the command ends is dropped.

    Args:
        workers: number of processes of this machine; 1 is this process. None: this one and, where the work takes long,
            others beside it, one for each core.
        cluster: ``tcp://HOST:PORT`` of a Dask scheduler, or ``local:N`` for one with N workers on this machine.

    Raises:
        InputError: the cluster cannot be reached, or what it takes is not installed; ``workers`` is no number of
            processes, or stands beside a cluster.
    """
    if workers is not None and (type(workers) is not int or not 1 <= workers <= MOST_WORKERS):
        problem = f"{workers!r} is no number of processes; give a whole one from 1 to {MOST_WORKERS}"
        raise InputError(problem, key="workers")
    if (workers or 1) > 1 and cluster is not None:
        raise InputError("the work runs in one place: leave it out beside a cluster", key="workers")
    with one_blas_thread():
        chosen = _chosen(workers, cluster)
        log.info("the work runs %s", chosen)
        try:
            yield chosen
        finally:
            chosen.shutdown(wait=False, cancel_futures=True)


def _chosen(workers: int | None, cluster: str | None) -> Executor:
    if cluster is not None:
        from trackbench.base.execution.cluster import connected

        return connected(cluster)
    if workers is None:
        return Shared(_others)
    if workers == 1:
        return InProcess()
    from trackbench.base.execution.local import LocalProcesses

    return LocalProcesses(workers)


def _others() -> tuple[Executor, int]:
    """Processes for the other cores that this one may use, and how many."""
    from loky import cpu_count

    from trackbench.base.execution.local import LocalProcesses

    number = cpu_count() - 1
    return (LocalProcesses(number), number) if number else (InProcess(), 0)
