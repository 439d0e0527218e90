"""The loop: every tracker steps through the measurements of each block of Monte-Carlo runs."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache

from trackbench.base.types import Progress, no_progress
from trackbench.engine.choice import users_kernels_compared
from trackbench.runner.block import Block, Blocks
from trackbench.runner.recorded import OnRecordedRun
from trackbench.runner.work import BlockRuns, Work

#: Parameters of mallopt(3), from malloc.h.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
#: Largest mmap threshold that glibc accepts, bytes.
LARGEST = 32 * 2**20


def run_block(
    work: Work, piece: BlockRuns, progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None
) -> Block:
    """Simulate, track and score a single block of runs."""
    (block,) = run_blocks(work, [piece], progress, on_recorded_run)
    return block


def run_blocks(
    work: Work,
    group: Sequence[BlockRuns],
    progress: Progress = no_progress,
    on_recorded_run: OnRecordedRun | None = None,
) -> list[Block]:
    """Simulate the measurements of some runs, step every tracker through them and score its answers.

    Args:
        work: data shared by all blocks.
        group: blocks of runs that are made together.
        progress: called with the number of finished runs and of all; each tracker counts for an equal part of a run.
        on_recorded_run: called with the recorded run (kept for plots), if it is in one of these blocks and identities
            are known.
    """
    keep_freed_memory()
    runs = sum(len(piece.runs) for piece in group)
    is_first = group[0].scene == group[0].runs.start == 0
    with users_kernels_compared(work.engine_here, is_first):
        blocks = Blocks(work, group, on_recorded_run)
        for number, name in enumerate(work.trackers):
            for tracker_run in blocks.tracker_runs(name):
                # An error of the tracker ends the context and becomes its failure.
                with tracker_run:
                    for arguments in tracker_run:
                        tracker_run.state, answer = tracker_run.tracker.step(tracker_run.state, *arguments)
                        tracker_run.take(answer)
                        progress((number + tracker_run.done) / len(work.trackers) * runs, runs)
    return blocks.blocks


@cache
def keep_freed_memory() -> None:
    """Let the C library keep the memory of freed arrays for the next step, rather than return it to the system.

    By default glibc maps each array of more than 128 KiB anew, so that a filter waits for fresh pages in every step.
    An extended Kalman filter loses a fifth of its time by that; three quarters in a Dask worker, whose environment sets
    low limits. Other C libraries are not affected.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGEST)
        mallopt(M_TRIM_THRESHOLD, 2 * LARGEST)
