"""The blocks of a run, made in one process or in several."""

from __future__ import annotations

import multiprocessing
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path

from trackbench.errors import TrackbenchError
from trackbench.interruption import allow_termination, uninterrupted
from trackbench.plugins import searched
from trackbench.runner.block import Block, OnRecordedRun, run_block
from trackbench.runner.work import BlockRuns, Work
from trackbench.types import Progress, no_progress

#: Least time between two words on how far a block is, s.
INTERVAL = 0.1
DIED = "a worker process died; --workers 1 may show what it died of"


def run_blocks(
    work: Work,
    pieces: Sequence[BlockRuns],
    workers: int,
    progress: Progress = no_progress,
    on_recorded_run: OnRecordedRun | None = None,
) -> Iterator[Block]:
    """The blocks in their order, however many processes make them.

    Args:
        work: what is the same for all of them.
        pieces: which blocks.
        workers: number of processes.
        progress: called with the number of runs done and of all.
        on_recorded_run: called with the recorded run as it is made, in this process, whichever makes it.

    Raises:
        TrackbenchError: a process died.
    """
    total = sum(len(piece.runs) for piece in pieces)
    if workers == 1 or len(pieces) <= 1:
        before = 0
        for piece in pieces:

            def reached(done: float, _: float, before: int = before) -> None:
                progress(before + done, total)

            yield run_block(work, piece, _now_and_then(reached), on_recorded_run)
            before += len(piece.runs)
        return
    # Not concurrent.futures: after one of its workers is killed within an answer, it waits for the rest for ever. Here
    # each worker has a pipe of its own, so that the end of either process is seen by the other.
    context = multiprocessing.get_context("spawn")
    processes, pipes = [], []
    try:
        with uninterrupted():
            for _ in range(min(workers, len(pieces))):
                ours, theirs = context.Pipe()
                process = context.Process(target=_serve, args=(theirs, work.folder))
                process.start()
                theirs.close()
                processes.append(process)
                pipes.append(ours)
        for pipe in pipes:
            pipe.send((work, on_recorded_run is not None))
        yield from _share_out(pieces, pipes, progress, on_recorded_run)
    except (EOFError, OSError) as error:
        raise TrackbenchError(DIED) from error
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()


def _share_out(
    pieces: Sequence[BlockRuns], pipes: Sequence[Connection], progress: Progress, on_recorded_run: OnRecordedRun | None
) -> Iterator[Block]:
    """A piece for every worker that waits for one, and the blocks in the order of the pieces."""
    todo = iter(enumerate(pieces))
    under_way: dict[Connection, int] = {}
    made: dict[int, Block] = {}
    done = [0.0] * len(pieces)

    def give(pipe: Connection) -> None:
        number, piece = next(todo, (None, None))
        if number is not None:
            pipe.send(piece)
            under_way[pipe] = number

    for pipe in pipes:
        give(pipe)
    for number in range(len(pieces)):
        while number not in made:
            for ready in wait(list(under_way)):
                assert isinstance(ready, Connection)
                answer = ready.recv()
                if isinstance(answer, Exception):
                    raise answer
                here = under_way[ready]
                if isinstance(answer, Block):
                    done[here] = len(pieces[here].runs)
                    made[here] = answer
                    del under_way[ready]
                    give(ready)
                elif isinstance(answer, float):
                    done[here] = answer
                else:
                    assert on_recorded_run is not None
                    on_recorded_run(answer)
                progress(sum(done), sum(len(piece.runs) for piece in pieces))
        yield made.pop(number)


def _now_and_then(progress: Progress) -> Progress:
    """The same, called no more often than the interval allows."""
    told = time.monotonic()

    def call(done: float, total: float) -> None:
        nonlocal told
        now = time.monotonic()
        if now - told >= INTERVAL:
            told = now
            progress(done, total)

    return call


def _serve(pipe: Connection, folder: Path | None) -> None:
    """A worker process: runs the pieces that it is given until it is told to end, or the other side has ended."""
    allow_termination()
    # What a tracker prints is no part of the result.
    sys.stdout = sys.stderr
    try:
        # The work may hold classes of the user's own, from a module beside the scenario.
        with searched(folder):
            work, observed = pipe.recv()
        while True:
            piece = pipe.recv()
            try:
                on_recorded_run = pipe.send if observed else None
                pipe.send(run_block(work, piece, _now_and_then(lambda done, _: pipe.send(done)), on_recorded_run))
            except Exception as error:
                error.add_note(traceback.format_exc())
                pipe.send(error)
    except (EOFError, OSError):
        return
