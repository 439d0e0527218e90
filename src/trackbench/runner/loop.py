"""The loop: blocks of Monte-Carlo runs, their measurements, and every tracker through them."""

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
#: The largest that glibc takes, bytes.
LARGEST = 32 * 2**20


def run_block(
    work: Work, piece: BlockRuns, progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None
) -> Block:
    """A single block; as ``run_blocks``."""
    (block,) = run_blocks(work, [piece], progress, on_recorded_run)
    return block


def run_blocks(
    work: Work,
    group: Sequence[BlockRuns],
    progress: Progress = no_progress,
    on_recorded_run: OnRecordedRun | None = None,
) -> list[Block]:
    """Synthesise the measurements of some runs, take every tracker through them and score it.

    Args:
        work: what all blocks share.
        group: a group of ``Work.groups``.
        progress: called with the number of runs done and of all; each tracker's part of a run counts alike.
        on_recorded_run: called with the recorded run, if it is in one of these blocks and identities are known.
    """
    keep_freed_memory()
    runs = sum(len(piece.runs) for piece in group)
    is_first = group[0].scene == group[0].runs.start == 0
    with users_kernels_compared(work.engine_here, is_first):
        blocks = Blocks(work, group, on_recorded_run)
        for number, name in enumerate(work.trackers):
            for tracker_run in blocks.tracker_runs(name):
                # What the tracker raises ends the context, and is kept as its failure.
                with tracker_run:
                    for arguments in tracker_run:
                        tracker_run.state, answer = tracker_run.tracker.step(tracker_run.state, *arguments)
                        tracker_run.take(answer)
                        progress((number + tracker_run.done) / len(work.trackers) * runs, runs)
    return blocks.blocks


@cache
def keep_freed_memory() -> None:
    """Let the C library keep freed arrays for the next step, where it would return them to the system.

    At first glibc maps every block of more than 128 KiB from the system and unmaps it again, so that each step of a
    filter waits for fresh pages: a fifth of the time of an extended Kalman filter, and three quarters in a Dask worker,
    whose environment fixes the limits low. Other C libraries are not affected.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGEST)
        mallopt(M_TRIM_THRESHOLD, 2 * LARGEST)
