"""The trials of one tracker, on identical measurements: each trial runs as a tracker of its own."""

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

#: Number of trials in one call if there is a single block of runs, so that several processes share the search.
TRIALS_IN_CALL = 3


class TrialOutcome(NamedTuple):
    """Result of a trial (one set of option values) in one scenario: sums of its scores, or a failure."""

    sums: Sums | None
    failed: str = ""
    """Reason why there are no sums; empty where there are sums."""


@dataclass(frozen=True)
class Bench:
    """Scenario with its ground truth, on which trials of option values are run."""

    scenario: Scenario
    truths: Sequence[LoadedTruth]
    held_out: bool | None = None
    """True scores the held-out stretches of a log, False the stretches for tuning, None the whole log."""

    @property
    def name(self) -> str:
        return self.scenario.config.name

    @property
    def hidden(self) -> bool:
        """Whether the identities of detections are hidden."""
        return self.scenario.config.sensing.identities == "hidden"


class _Block(NamedTuple):
    """Block of runs with the settings that all its trials share."""

    work: Work
    piece: BlockRuns
    counted: Availability | None
    """Masks of the innovations that count; None with hidden identities, and for the start, which determines them."""
    metric: Metric | None
    """Metric whose best value the tuning seeks; None if it seeks that of a built-in measure."""
    measure: str
    """Track measure that is summed in addition to the usual ones."""
    log_time: LogTime | None
    """Division of a single run into stretches that are summed separately; None to sum whole runs."""


class _Piece(NamedTuple):
    """Result of a trial in a block of runs."""

    sums: Sums | str
    """Sums of the trial, or the reason of its failure."""
    available: Availability | None = None
    """Masks of the innovations that were summed; None with hidden identities."""
    engine: EngineUsed | None = None
    """Engine that computed a built-in tracker; None for any other tracker."""


class _Start(NamedTuple):
    """Result of the tracker with its start values (options as in the scenario) in one scenario."""

    outcome: TrialOutcome
    counted: Mapping[BlockRuns, Availability | None]
    """Masks of the innovations that count, by block of runs; None with hidden identities."""
    engine: EngineUsed | None
    """Engine that computed a built-in tracker; None for any other tracker."""


class Evaluator:
    """Evaluation of trials of one tracker, all scored on the innovations that its start values give.

    Args:
        benches: scenarios with their ground truth.
        tracker: name of the tracker in each scenario.
        executor: makes the trials, in this process or others.
        isolation: how a tracker that is not built in is kept apart.
        engine: ``auto``, ``numpy`` or ``fused``.
        trials: expected number of trials, by which ``auto`` chooses the engine.
        metric: metric that is summed in addition to the usual measures.
        measure: track measure that is summed in addition to the usual ones.
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
        """Return the scene number of each run, ``(runs,)``; zeros ``(stretches,)`` for stretches of a single run."""
        sums = self._start[bench].outcome.sums
        if self._log_time(bench) is None or sums is None:
            return self._work[bench].scene_of_run
        return np.zeros(sums.values["nees"].shape[1], dtype=np.intp)

    @property
    def start(self) -> list[TrialOutcome]:
        """Outcomes of the start values, by scenario."""
        return [start.outcome for start in self._start]

    @property
    def engine_used(self) -> EngineUsed | None:
        """Engine that computes a built-in tracker; None for any other tracker."""
        return joined_engines(start.engine for start in self._start if start.engine is not None)

    def __call__(self, points: Sequence[Values], progress: Progress = no_progress) -> list[list[TrialOutcome]]:
        """Return the outcome of each point (set of option values) in each scenario; the start must not fail.

        Args:
            points: values by option; empty for the tracker with its start values.
            progress: called with the number of finished parts and of all parts.
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
            size = TRIALS_IN_CALL if blocks == 1 else max(1, len(trials))
            groups = [trials[first : first + size] for first in range(0, len(trials), size)]
            results = self._make(bench, [{trial: entries[trial] for trial in group} for group in groups], self._start)
            pending += [(bench, results)] * (len(groups) * blocks)
        for done, (bench, results) in enumerate(pending):
            progress(done, len(pending))
            for trial, piece in next(results).items():
                parts[trial][bench].append(piece.sums)
        progress(len(pending), len(pending))
        return [[_join(of_bench) for of_bench in of_trial] for of_trial in parts]

    @cached_property
    def _start(self) -> list[_Start]:
        """Results of the start values. If a kernel of a user's model differs from NumPy, NumPy computes all trials."""
        starts = self._run_start()
        if not any(start.engine is not None and start.engine.differs for start in starts):
            return starts
        self._work = [replace(work, engine="numpy") for work in self._work]
        engines = [start.engine and start.engine._replace(engine="numpy", differs=False) for start in starts]
        return [start._replace(engine=engine) for start, engine in zip(self._run_start(), engines, strict=True)]

    def _run_start(self) -> list[_Start]:
        made = [
            self._make(number, [{0: bench.scenario.config.driven(self.tracker)}])
            for number, bench in enumerate(self.benches)
        ]
        starts = []
        for work, results in zip(self._work, made, strict=True):
            pieces = {piece: next(results)[0] for piece in work.pieces()}
            counted = {runs: piece.available for runs, piece in pieces.items()}
            engine = joined_engines(piece.engine for piece in pieces.values() if piece.engine is not None)
            starts.append(_Start(_join([piece.sums for piece in pieces.values()]), counted, engine))
        return starts

    def _make(
        self, bench: int, groups: Sequence[Mapping[int, Entry]], starts: Sequence[_Start] = ()
    ) -> Iterator[dict[int, _Piece]]:
        """Yield the results, by trial number, of each group of trials in each block of a scenario's runs."""
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
        """Return the stretches into which a single run is divided; None where runs or scenes are independent."""
        work = self._work[bench]
        if work.hidden or self._metric is not None or not work.over_stretches:
            return None
        return LogTime(max(work.settle, GAP), self.benches[bench].held_out)


def _trials_of_block(block: _Block, entries: Mapping[int, Entry]) -> dict[int, _Piece]:
    """Run trials on a block of runs, and return their results by trial number; any process can call it."""
    work, metrics = block.work, () if block.metric is None else metrics_of_trial(block.metric)
    work = replace(work, trackers={str(trial): entry for trial, entry in entries.items()})
    if not work.hidden:
        sums = TrialSums(log_time=block.log_time, counted=block.counted)
        work = replace(work, metrics=(Coverage(), sums, *metrics[1:]))
    made = run_block(work, block.piece)
    return {trial: _piece(block, made.outcomes[str(trial)], made.engines.get(str(trial))) for trial in entries}


def _piece(block: _Block, outcome: Outcome | Failure, engine: EngineUsed | None) -> _Piece:
    if isinstance(outcome, Failure):
        return _Piece(outcome.cause, None, engine)
    available = None
    if block.work.hidden:
        measures = {path: path for path in (*OF_TRACKS, block.measure) if path in TRACK_METRICS}
        measures["prediction_score"] = "log_likelihood"
        values = {name: run_sums(outcome.sums[TRACKS.name], path) for path, name in measures.items()}
    else:
        values, available = outcome.sums[TrialSums.name]
    metrics = () if block.metric is None else metrics_of_trial(block.metric)
    blocks = ({name: outcome.sums[name] for name in accumulators(metrics)},) if metrics else ()
    return _Piece(Sums(values, block.metric, blocks), available, engine)


def _join(parts: Sequence[Sums | str]) -> TrialOutcome:
    """Return the outcome of a trial over all blocks of runs; the first failure if a block failed."""
    for part in parts:
        if isinstance(part, str):
            return TrialOutcome(None, part)
    return TrialOutcome(Sums.joined([part for part in parts if isinstance(part, Sums)]))
