"""The trials of one tracker, all on identical measurements: each is a tracker of its own in a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from trackbench.base.execution import Executor
from trackbench.base.types import Indices, Progress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName, choose_engine
from trackbench.engine.equations import EngineUsed, joined_engines
from trackbench.metrics import Metric
from trackbench.metrics.built_in.basic import Coverage
from trackbench.metrics.evaluate import accumulators
from trackbench.metrics.traffic import TRACK_METRICS, TRACKS, run_sums
from trackbench.results import Failure
from trackbench.runner.loop import run_block
from trackbench.runner.recorded import Outcome
from trackbench.runner.work import BlockRuns, Work, work_of
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.subjects.tuning.entry import Entry, Values, entry_with
from trackbench.subjects.tuning.measures import OF_TRACKS, Sums, metrics_of_trial
from trackbench.subjects.tuning.trial_sums import GAP, Availability, LogTime, TrialSums
from trackbench.truth import LoadedTruth

#: Trials that go through the only block of a search one after the other, so that several processes share the search.
TOGETHER = 3


class TrialOutcome(NamedTuple):
    """Result of a trial in one scenario."""

    sums: Sums | None
    failed: str = ""
    """Reason why there are none."""


@dataclass(frozen=True)
class Bench:
    """A scenario with the truth on which trials are made."""

    scenario: Scenario
    truths: Sequence[LoadedTruth]
    held_out: bool | None = None
    """Whether the held-out stretches of a log are scored, or the stretches that are tuned on; None for all."""

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.scenario.config.name

    @property
    def hidden(self) -> bool:
        """Whether the identities of detections are hidden."""
        return self.scenario.config.sensing.identities == "hidden"


class _Block(NamedTuple):
    """What the trials of a block of runs share."""

    work: Work
    piece: BlockRuns
    counted: Availability | None
    """Counted innovations; None where identities are hidden, and for the start, which decides what counts."""
    metric: Metric | None
    """Metric of the objective, if it is none of the usual measures."""
    measure: str
    """Measure of tracks that is summed beside the usual ones."""
    log_time: LogTime | None
    """Stretches of a single run that are summed by themselves."""


class _Piece(NamedTuple):
    """Result of a trial in a block of runs."""

    sums: Sums | str
    """Sums, or the reason why there are none."""
    available: Availability | None = None
    """Innovations that were summed, if identities are known."""
    engine: EngineUsed | None = None
    """What computed a built-in tracker."""


class _Start(NamedTuple):
    """Result of the tracker before it is tuned, in one scenario."""

    outcome: TrialOutcome
    counted: Mapping[BlockRuns, Availability | None]
    """Innovations that count, by block."""
    engine: EngineUsed | None
    """What computed a built-in tracker; None for any other."""


class Evaluator:
    """Makes trials of one tracker, each scored on the estimates and innovations that the start gives.

    Args:
        benches: the scenarios.
        tracker: its name in each.
        executor: what makes the trials.
        isolation: how a tracker that is not built in is kept apart.
        engine: what computes.
        trials: about how many will be made.
        metric: that is summed beside the usual measures.
        measure: of tracks, that is kept beside the usual ones.
    """

    def __init__(
        self,
        benches: Sequence[Bench],
        tracker: str,
        executor: Executor,
        isolation: Isolation = ISOLATED,
        engine: EngineName = "numpy",
        trials: int = 1,
        metric: Metric | None = None,
        measure: str = "tgospa",
    ) -> None:
        self.benches, self.tracker = benches, tracker
        self._executor = executor
        self._metric, self._measure = metric, measure
        works = [work_of(bench.scenario, bench.truths, isolation) for bench in benches]
        self.engine = choose_engine(engine, trials * sum(work.steps for work in works))
        self._work = [replace(work, engine=self.engine, recorded_run=-1, driven_twice=None) for work in works]

    def scenes(self, bench: int) -> Indices:
        """``(runs,)`` number of the scene of each run of a scenario; of stretches of time, which are taken for
        independent, ``(stretches,)`` the same."""
        sums = self._start[bench].outcome.sums
        if self._log_time(bench) is None or sums is None:
            return self._work[bench].scene_of_run
        return np.zeros(sums.values["nees"].shape[1], dtype=np.intp)

    @property
    def start(self) -> list[TrialOutcome]:
        """Outcomes of the tracker before it is tuned, by scenario."""
        return [start.outcome for start in self._start]

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computes a built-in tracker; None for any other."""
        return joined_engines(start.engine for start in self._start if start.engine is not None)

    def __call__(self, points: Sequence[Values], progress: Progress = no_progress) -> list[list[TrialOutcome]]:
        """Return the outcome of each point in each scenario; the start must not fail in any.

        Args:
            points: values by the options' keys; empty for the tracker as it is.
            progress: called with how many parts are done and how many there are.
        """
        parts: list[list[list[Sums | str]]] = [[[] for _ in self.benches] for _ in points]
        pending = []
        for bench in range(len(self.benches)):
            entries: dict[int, Entry] = {}
            for trial, point in enumerate(points):
                try:
                    entries[trial] = entry_with(self.benches[bench].scenario, self.tracker, point)
                except ValidationError as invalid:
                    parts[trial][bench].append(invalid.errors()[0]["msg"])
            trials, blocks = [*entries], len(self._work[bench].pieces())
            size = TOGETHER if blocks == 1 else max(1, len(trials))
            groups = [trials[first : first + size] for first in range(0, len(trials), size)]
            made = self._made(bench, [{trial: entries[trial] for trial in group} for group in groups], self._start)
            pending += [(bench, made)] * (len(groups) * blocks)
        for done, (bench, made) in enumerate(pending):
            progress(done, len(pending))
            for trial, piece in next(made).items():
                parts[trial][bench].append(piece.sums)
        progress(len(pending), len(pending))
        return [[_joined(of_bench) for of_bench in of_trial] for of_trial in parts]

    @cached_property
    def _start(self) -> list[_Start]:
        """Results of the start. Where a kernel of a user's model differs, NumPy computes the start and all trials."""
        starts = self._started()
        if not any(start.engine is not None and start.engine.differs for start in starts):
            return starts
        self._work = [replace(work, engine="numpy") for work in self._work]
        engines = [start.engine and start.engine._replace(engine="numpy", differs=False) for start in starts]
        return [start._replace(engine=engine) for start, engine in zip(self._started(), engines, strict=True)]

    def _started(self) -> list[_Start]:
        made = [
            self._made(number, [{0: bench.scenario.config.driven(self.tracker)}])
            for number, bench in enumerate(self.benches)
        ]
        starts = []
        for work, results in zip(self._work, made, strict=True):
            pieces = {piece: next(results)[0] for piece in work.pieces()}
            counted = {place: piece.available for place, piece in pieces.items()}
            engine = joined_engines(piece.engine for piece in pieces.values() if piece.engine is not None)
            starts.append(_Start(_joined([piece.sums for piece in pieces.values()]), counted, engine))
        return starts

    def _made(
        self, bench: int, groups: Sequence[Mapping[int, Entry]], starts: Sequence[_Start] = ()
    ) -> Iterator[dict[int, _Piece]]:
        """Make the trials of each group in each block of runs of a scenario."""
        work, log_time = self._work[bench], self._log_time(bench)
        blocks = [
            _Block(
                work.of_scenes([piece.scene]),
                piece,
                starts[bench].counted[piece] if starts else None,
                self._metric,
                self._measure,
                log_time,
            )
            for piece in work.pieces()
        ]
        calls = [(block, group) for group in groups for block in blocks]
        return self._executor.map(_trials_of_block, calls, own_folder(self.benches[bench].scenario))

    def _log_time(self, bench: int) -> LogTime | None:
        """Return the stretches of time of a single run; None where runs or scenes are independent."""
        work = self._work[bench]
        if work.hidden or self._metric is not None or not work.over_stretches:
            return None
        return LogTime(max(work.settle, GAP), self.benches[bench].held_out)


def _trials_of_block(block: _Block, entries: Mapping[int, Entry]) -> dict[int, _Piece]:
    """Make some trials in a block of runs; called in any process."""
    work, own = block.work, () if block.metric is None else metrics_of_trial(block.metric)
    work = replace(work, trackers={str(trial): entry for trial, entry in entries.items()})
    if not work.hidden:
        sums = TrialSums(log_time=block.log_time, counted=block.counted)
        work = replace(work, metrics=(Coverage(), sums, *own[1:]))
    made = run_block(work, block.piece)
    return {trial: _piece(block, made.outcomes[str(trial)], made.engines.get(str(trial))) for trial in entries}


def _piece(block: _Block, outcome: Outcome | Failure, engine: EngineUsed | None) -> _Piece:
    """Return what is kept of a trial in a block."""
    if isinstance(outcome, Failure):
        return _Piece(outcome.cause, None, engine)
    available = None
    if block.work.hidden:
        measures = {path: path for path in (*OF_TRACKS, block.measure) if path in TRACK_METRICS}
        measures["prediction_score"] = "log_likelihood"
        values = {name: run_sums(outcome.sums[TRACKS.name], path) for path, name in measures.items()}
    else:
        values, available = outcome.sums[TrialSums.name]
    own = () if block.metric is None else metrics_of_trial(block.metric)
    blocks = ({name: outcome.sums[name] for name in accumulators(own)},) if own else ()
    return _Piece(Sums(values, block.metric, blocks), available, engine)


def _joined(parts: Sequence[Sums | str]) -> TrialOutcome:
    """Return the outcome over the runs of all scenes."""
    for part in parts:
        if isinstance(part, str):
            return TrialOutcome(None, part)
    return TrialOutcome(Sums.joined([part for part in parts if isinstance(part, Sums)]))
