"""The blocks of a run, wherever they are made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from typing import Any

from trackbench.base.execution import Here, InProcess, Task
from trackbench.base.types import Progress, Scan, no_progress
from trackbench.runner.block import OnRecordedRun, run_block
from trackbench.runner.recorded import RecordedInstant
from trackbench.runner.traffic import run_traffic_block
from trackbench.runner.work import BlockRuns, Work
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder


class PendingBlocks:
    """The blocks of a run, being made.

    Args:
        loaded: the scenario.
        work: what is the same for all of them.
        pieces: which blocks.
        executor: what makes them.
        observed: whether the recorded run is looked at, so that its block has to be made in this process.
        alone: whether nothing else is made at the same time, so that a single block is no work for another process.
    """

    def __init__(
        self,
        loaded: Scenario,
        work: Work,
        pieces: Sequence[BlockRuns],
        executor: Executor,
        *,
        observed: bool = False,
        alone: bool = True,
    ) -> None:
        self._pieces = pieces
        self._done, self._total = 0, sum(len(piece.runs) for piece in pieces)
        self._progress: Progress = no_progress
        self._on_recorded_run: OnRecordedRun | None = None
        folder = own_folder(loaded)
        make = run_block if work.cutoff is None else run_traffic_block
        tasks = {scene: Task(make, work.of_scene(scene), folder) for scene in {piece.scene for piece in pieces}}
        here = InProcess()
        if alone and len(pieces) == 1:
            executor = here
        self._futures = [
            (here if observed and work.has_recorded_run(piece) else executor).submit(
                tasks[piece.scene], piece, Here(self._advance), Here(self._observe) if observed else None
            )
            for piece in pieces
        ]

    def collect(self, progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None) -> Iterator[Any]:
        """The blocks in their order, as they are done: each a ``Block``, or where identities are hidden a
        ``TrafficBlock``.

        Args:
            progress: called with the number of runs done and of all.
            on_recorded_run: called with the recorded run as it is made, where it is observed.

        Raises:
            TrackbenchError: the processes that make them died.
        """
        self._progress, self._on_recorded_run = progress, on_recorded_run
        for piece, future in zip(self._pieces, self._futures, strict=True):
            yield future.result()
            self._done += len(piece.runs)
            self._progress(self._done, self._total)

    def _advance(self, done: float, _: float) -> None:
        self._progress(self._done + done, self._total)

    def _observe(self, seen: list[Scan] | RecordedInstant) -> None:
        if self._on_recorded_run is not None:
            self._on_recorded_run(seen)
