"""The trials of one tracker: all on identical measurements, as many in one batch as differ in noise levels alone."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from trackbench.base.execution import Executor
from trackbench.base.types import Indices, Progress, no_progress
from trackbench.driving.faults import fault_of
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName, chosen
from trackbench.engine.equations import EngineUsed, joined_engines
from trackbench.metrics import Metric
from trackbench.metrics.traffic import TRACK_METRICS, TRACKS, run_sums
from trackbench.results import Failure
from trackbench.runner.loop import run_block
from trackbench.runner.work import LARGEST_BATCH, BlockRuns, Work, work_of
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.subjects.tuning.entry import Entry, Values, combined, entry_with, varies_in_batch
from trackbench.subjects.tuning.labelled import GAP, Availability, LogTime, score_labelled
from trackbench.subjects.tuning.measures import OF_TRACKS, Sums, metrics_of_trial
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.trackers.config import FilterConfig
from trackbench.truth import LoadedTruth

TRIAL = "trial"


#: Most trials of one batch, so that several processes share them.
MOST_TRIALS = 64


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


class _Batch(NamedTuple):
    """Trials that go through the measurements together."""

    trials: tuple[int, ...]
    """Indices of the trials among all."""
    entries: tuple[Entry, ...]
    points: tuple[Values, ...]
    keys: tuple[str, ...]
    """Options in which the trials differ."""

    def part(self, here: slice) -> _Batch:
        """Return the batch of some of the trials."""
        return _Batch(self.trials[here], self.entries[here], self.points[here], self.keys)


class _Start(NamedTuple):
    """Result of the tracker before it is tuned, in one scenario."""

    outcome: TrialOutcome
    counted: tuple[Availability | None, ...]
    """Counted innovations by scene; None where the tracker failed or identities are hidden."""
    engine: EngineUsed | None
    """What computed a built-in tracker; None for any other."""


class _Piece(NamedTuple):
    """Result of a trial in some runs of one scene."""

    sums: Sums | str
    """Sums, or the reason why there are none."""
    available: Availability | None = None
    """Innovations of the start, if identities are known."""
    engine: EngineUsed | None = None
    """What computed a built-in tracker."""


class _Scene(NamedTuple):
    """Constants of all trials of a scene."""

    work: Work
    counted: Availability | None
    """Counted innovations; None where identities are hidden, and for the start, which decides what counts."""
    metric: Metric | None
    """Metric of the objective, if it is none of the usual measures."""
    measure: str
    """Measure of tracks that is summed beside the usual ones."""
    log_time: LogTime | None = None
    """Stretches of a single run that are summed by themselves."""


class Evaluator:
    """Makes trials of one tracker, each scored on the estimates and innovations that the start gives.

    Args:
        benches: the scenarios.
        tracker: its name in each.
        parameters: what differs between trials.
        executor: what makes them.
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
        parameters: Sequence[Parameter],
        executor: Executor,
        isolation: Isolation = ISOLATED,
        engine: EngineName = "numpy",
        trials: int = 1,
        metric: Metric | None = None,
        measure: str = "tgospa",
    ) -> None:
        self.benches, self.tracker, self.parameters = benches, tracker, parameters
        self._executor = executor
        self._metric, self._measure = metric, measure
        work = [work_of(bench.scenario, bench.truths, isolation) for bench in benches]
        self.engine = chosen(engine, trials * sum(item.steps for item in work))
        self._work = [replace(item, engine=self.engine) for item in work]

    def scenes(self, bench: int) -> Indices:
        """``(runs,)`` number of the scene of each run of a scenario; of stretches of time, which are taken for
        independent, ``(stretches,)`` the same."""
        sums = self._start[bench].outcome.sums
        if self._log_time(self.benches[bench], self._work[bench]) is None or sums is None:
            return self._work[bench].scene_of_run
        return np.zeros(sums.values["nees"].shape[1], dtype=np.intp)

    def _log_time(self, bench: Bench, work: Work) -> LogTime | None:
        """Return the stretches of time of a single run; None where runs or scenes are independent."""
        if bench.hidden or self._metric is not None or not work.over_stretches:
            return None
        return LogTime(max(work.settle, GAP), bench.held_out)

    @property
    def start(self) -> list[TrialOutcome]:
        """Outcomes of the tracker before it is tuned, by scenario."""
        return [start.outcome for start in self._start]

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computes a built-in tracker; None for any other."""
        return joined_engines(start.engine for start in self._start if start.engine is not None)

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
        benches = []
        for bench, work in zip(self.benches, self._work, strict=True):
            batch = _Batch((0,), (bench.scenario.config.driven(self.tracker),), ({},), ())
            benches.append((work, self._made(bench, work, [batch])))
        starts = []
        for work, made in benches:
            scenes = range(len(work.scenes))
            results = [[next(made)[0] for _ in _pieces(work, scene, 1)] for scene in scenes]
            counted = []
            for pieces in results:
                masks = [piece.available for piece in pieces if piece.available is not None]
                counted.append(np.concatenate(masks, axis=-1) if len(masks) == len(pieces) else None)
            every = [piece for pieces in results for piece in pieces]
            engine = joined_engines(piece.engine for piece in every if piece.engine is not None)
            starts.append(_Start(_joined([piece.sums for piece in every]), tuple(counted), engine))
        return starts

    def __call__(self, points: Sequence[Values], progress: Progress = no_progress) -> list[list[TrialOutcome]]:
        """Return the outcome of each point in each scenario.

        Args:
            points: values by the parameters' keys; empty for the tracker as it is.
            progress: called with how many parts are done and how many there are.
        """
        sums: list[list[list[Sums | str]]] = [[[] for _ in self.benches] for _ in points]
        pending = []
        for number, (bench, work) in enumerate(zip(self.benches, self._work, strict=True)):
            start = self._start[number]
            batches = [*self._batches(bench.scenario, points, [outcomes[number] for outcomes in sums])]
            if start.outcome.sums is None:
                for trial in (trial for batch in batches for trial in batch.trials):
                    sums[trial][number].append("the tracker fails as it is")
                continue
            made = self._made(bench, work, batches, start.counted)
            pending += [(number, batch, made) for batch in batches for _ in _all_pieces(work, batch)]
        for done, (number, batch, made) in enumerate(pending):
            progress(done, len(pending))
            for trial, outcome in zip(batch.trials, next(made), strict=True):
                sums[trial][number].append(outcome.sums)
        progress(len(pending), len(pending))
        return [[_joined(parts) for parts in outcomes] for outcomes in sums]

    def _made(
        self, bench: Bench, work: Work, batches: Sequence[_Batch], counted: Sequence[Availability | None] = ()
    ) -> Iterator[list[_Piece]]:
        """Make the pieces of some batches, as ``_all_pieces`` orders them; an outcome for each trial of the batch."""
        make, log_time = _hidden if bench.hidden else _labelled, self._log_time(bench, work)
        constants = [
            _Scene(work.of_scenes([scene]), counted[scene] if counted else None, self._metric, self._measure, log_time)
            for scene in range(len(work.scenes))
        ]
        calls = [(constants[piece.scene], piece, batch) for batch in batches for piece in _all_pieces(work, batch)]
        return self._executor.map(make, calls, own_folder(bench.scenario))

    def _batches(
        self, loaded: Scenario, points: Sequence[Values], sums: Sequence[list[Sums | str]]
    ) -> Iterator[_Batch]:
        """Yield the trials in batches; note why a trial has values that do not go together."""
        groups: dict[str, _Batch] = {}
        for trial, point in enumerate(points):
            try:
                entry = entry_with(loaded, self.tracker, point)
            except ValidationError as invalid:
                sums[trial].append(invalid.errors()[0]["msg"])
                continue
            keys = tuple(key for key in point if varies_in_batch(entry, key))
            name = json.dumps({key: None if key in keys else value for key, value in point.items()}, sort_keys=True)
            group = groups.get(name, _Batch((), (), (), keys))
            groups[name] = _Batch((*group.trials, trial), (*group.entries, entry), (*group.points, point), keys)
        for group in groups.values():
            for first in range(0, len(group.trials), MOST_TRIALS):
                yield group.part(slice(first, first + MOST_TRIALS))


def _pieces(work: Work, scene: int, trials: int) -> Iterator[BlockRuns]:
    """Yield the runs of a scene in pieces that fit the processor's cache; pieces do not change the results."""
    size = max(1, LARGEST_BATCH // (trials * max(1, len(work.scenes[scene].truth.ids))))
    for first in range(0, work.runs, size):
        yield BlockRuns(scene, range(first, min(first + size, work.runs)))


def _all_pieces(work: Work, batch: _Batch) -> Iterator[BlockRuns]:
    """Yield the runs of all scenes, in pieces for the trials of a batch."""
    for scene in range(len(work.scenes)):
        yield from _pieces(work, scene, len(batch.trials))


def _hidden(scene: _Scene, piece: BlockRuns, batch: _Batch) -> list[_Piece]:
    """Make trials with hidden identities, one after the other."""
    pieces = []
    for entry in batch.entries:
        block = run_block(replace(scene.work, trackers={TRIAL: entry}), piece)
        scores, engine = block.outcomes[TRIAL], block.engines.get(TRIAL)
        if isinstance(scores, Failure):
            pieces.append(_Piece(scores.cause, None, engine))
            continue
        measures = {path: path for path in (*OF_TRACKS, scene.measure) if path in TRACK_METRICS}
        measures["prediction_score"] = "log_likelihood"
        values = {name: run_sums(scores.sums[TRACKS.name], path) for path, name in measures.items()}
        blocks = () if scene.metric is None else (scores.sums,)
        pieces.append(_Piece(Sums(values, scene.metric, blocks), None, engine))
    return pieces


def _labelled(scene: _Scene, piece: BlockRuns, batch: _Batch) -> list[_Piece]:
    """Make trials with known identities; the metric of the objective is summed in a second pass, as a run does."""
    pieces = _together(scene, piece, batch)
    if scene.metric is None:
        return pieces
    metrics = metrics_of_trial(scene.metric)
    for number, (made, entry) in enumerate(zip(pieces, batch.entries, strict=True)):
        if isinstance(made.sums, Sums):
            outcome = run_block(replace(scene.work, trackers={TRIAL: entry}, metrics=metrics), piece).outcomes[TRIAL]
            if isinstance(outcome, Failure):
                pieces[number] = made._replace(sums=outcome.cause)
                continue
            assert not isinstance(outcome, Failure)
            pieces[number] = made._replace(sums=replace(made.sums, metric=scene.metric, blocks=(outcome.sums,)))
    return pieces


def _together(scene: _Scene, piece: BlockRuns, batch: _Batch) -> list[_Piece]:
    """Return the usual measures of a batch; where the arithmetic of one trial fails, make each trial by itself."""
    number, entry, work = len(batch.trials), batch.entries[0], scene.work
    counted = None if scene.counted is None else scene.counted[..., piece.runs.start : piece.runs.stop]
    if number > 1 and isinstance(entry, FilterConfig) and batch.keys:
        size = len(work.scenes[piece.scene].truth.ids) * len(piece.runs)
        # Trials come slowest.
        columns = {key: np.repeat(np.array([float(point[key]) for point in batch.points]), size) for key in batch.keys}
        entry = combined(entry, columns)
    try:
        sums, available, engine = score_labelled(work, piece, entry, number, counted, scene.log_time)
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        if number == 1:
            return [_Piece(fault_of(error).cause)]
        if not isinstance(error, np.linalg.LinAlgError):
            raise
        return [_together(scene, piece, batch.part(slice(i, i + 1)))[0] for i in range(number)]
    return [_Piece(item, available if counted is None else None, engine) for item in sums]


def _joined(parts: Sequence[Sums | str]) -> TrialOutcome:
    """Return the outcome over the runs of all scenes."""
    for part in parts:
        if isinstance(part, str):
            return TrialOutcome(None, part)
    return TrialOutcome(Sums.joined([part for part in parts if isinstance(part, Sums)]))
