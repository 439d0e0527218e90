"""The blocks of a run, made in one process or in several."""

from __future__ import annotations

import multiprocessing
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from trackbench.errors import TrackbenchError
from trackbench.runner.block import Block, Work, run_block


def run_blocks(work: Work, workers: int) -> Iterator[Block]:
    """The blocks in their order, however many processes make them.

    Raises:
        TrackbenchError: a process died.
    """
    pieces = work.blocks()
    if workers == 1 or len(pieces) == 1:
        yield from (run_block(work, runs) for runs in pieces)
        return
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(
        min(workers, len(pieces)), mp_context=context, initializer=_prepare, initargs=(work,)
    ) as pool:
        try:
            with _uninterrupted():
                blocks = [pool.submit(_run_prepared, runs) for runs in pieces]
            yield from (block.result() for block in blocks)
        except BrokenProcessPool as error:
            raise TrackbenchError("a worker process died; --workers 1 may show what it died of") from error
        except BaseException:
            # Leaving the pool would wait for every block that is still to come.
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """With Ctrl-C held back; processes that start meanwhile never get it, and so do not print a traceback each."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_prepared: Work | None = None


def _prepare(work: Work) -> None:
    """Begin a worker process. What a tracker prints there is no part of the result."""
    global _prepared
    _prepared = work
    sys.stdout = sys.stderr


def _run_prepared(runs: range) -> Block:
    assert _prepared is not None
    return run_block(_prepared, runs)
