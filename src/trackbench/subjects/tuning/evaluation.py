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
from trackbench.subjects.tuning.labelled import GAP, LogTime, PackedAvailability, score_labelled
from trackbench.subjects.tuning.measures import OF_TRACKS, Sums, metrics_of_trial
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.trackers.config import FilterConfig
from trackbench.truth import LoadedTruth

TRIAL = "trial"


#: Most trials of one batch, so that several processes share them.
MOST_TRIALS = 64


class Outcome(NamedTuple):
    """What became of a trial in one scenario."""

    sums: Sums | None
    failed: str = ""
    """Why it has none."""


@dataclass(frozen=True)
class Bench:
    """A scenario with the truth on which trials are made."""

    scenario: Scenario
    truths: Sequence[LoadedTruth]
    held_out: bool | None = None
    """Of a log, whether it is the stretches of time that are held out, or those that are tuned on; None: all."""

    @property
    def name(self) -> str:
        """Of the scenario."""
        return self.scenario.config.name

    @property
    def hidden(self) -> bool:
        """Whether nobody labelled the detections."""
        return self.scenario.config.sensing.identities == "hidden"


class _Batch(NamedTuple):
    """Trials that go through the measurements together."""

    trials: tuple[int, ...]
    """Their places among all."""
    entries: tuple[Entry, ...]
    points: tuple[Values, ...]
    keys: tuple[str, ...]
    """In which they differ."""

    def part(self, here: slice) -> _Batch:
        """Some of the trials."""
        return _Batch(self.trials[here], self.entries[here], self.points[here], self.keys)


class _Start(NamedTuple):
    """What the tracker gives as it is in one scenario."""

    outcome: Outcome
    counted: tuple[PackedAvailability | None, ...]
    """Of each scene; None where it failed, and where nobody labelled the detections."""
    engine: EngineUsed | None
    """What computed it; None of a tracker that is not built in."""


class _Piece(NamedTuple):
    """What a trial gives in some runs of one scene."""

    sums: Sums | str
    """Or why there are none."""
    available: PackedAvailability | None = None
    """Of the start of a tracker of labelled objects."""
    engine: EngineUsed | None = None
    """What computed the tracker."""


class _Scene(NamedTuple):
    """What all trials of a scene share."""

    work: Work
    counted: PackedAvailability | None
    """None where nobody labelled the detections, and for the start, which says what is counted."""
    metric: Metric | None
    """That is summed beside the usual measures, where it is none of these."""
    measure: str
    """Of tracks, that is kept beside the usual ones."""
    log_time: LogTime | None = None
    """Of a single run, the stretches of time that are summed by themselves."""


class Evaluator:
    """Makes trials of one tracker, each scored on the estimates and innovations that the tracker gives as it is.

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
        """The stretches of time of a single run; None where runs or scenes are what is independent."""
        if bench.hidden or self._metric is not None or not work.over_stretches:
            return None
        return LogTime(max(work.settle, GAP), bench.held_out)

    @property
    def start(self) -> list[Outcome]:
        """What the tracker gives as it is, in each scenario."""
        return [start.outcome for start in self._start]

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computes the tracker; None of one that is not built in."""
        return joined_engines(start.engine for start in self._start if start.engine is not None)

    @cached_property
    def _start(self) -> list[_Start]:
        """What the tracker gives as it is; by NumPy, as all trials then, where a kernel of a user's model differs."""
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
                counted.append(PackedAvailability.joined(masks) if len(masks) == len(pieces) else None)
            every = [piece for pieces in results for piece in pieces]
            engine = joined_engines(piece.engine for piece in every if piece.engine is not None)
            starts.append(_Start(_joined([piece.sums for piece in every]), tuple(counted), engine))
        return starts

    def __call__(self, points: Sequence[Values], progress: Progress = no_progress) -> list[list[Outcome]]:
        """Of each point its outcome in each scenario.

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
        self, bench: Bench, work: Work, batches: Sequence[_Batch], counted: Sequence[PackedAvailability | None] = ()
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
        """The trials in batches; of one whose values do not go together it is noted why."""
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
    """The runs of a scene, so many at a time that a batch fits the processor's cache; it does not change them."""
    size = max(1, LARGEST_BATCH // (trials * max(1, len(work.scenes[scene].truth.ids))))
    for first in range(0, work.runs, size):
        yield BlockRuns(scene, range(first, min(first + size, work.runs)))


def _all_pieces(work: Work, batch: _Batch) -> Iterator[BlockRuns]:
    """The runs of all scenes, in pieces for the trials of a batch."""
    for scene in range(len(work.scenes)):
        yield from _pieces(work, scene, len(batch.trials))


def _hidden(scene: _Scene, piece: BlockRuns, batch: _Batch) -> list[_Piece]:
    """Trials that follow several objects from detections of hidden identities, one after the other."""
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
    """Trials of single objects, with what the objective's metric sums of the same runs, as a run sums it."""
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
    """The usual measures of the trials of a batch; where the arithmetic of one fails, each by itself."""
    number, entry, work = len(batch.trials), batch.entries[0], scene.work
    counted = None if scene.counted is None else scene.counted.of_runs(piece.runs).unpacked()
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
    return [_Piece(item, PackedAvailability.of(available) if counted is None else None, engine) for item in sums]


def _joined(parts: Sequence[Sums | str]) -> Outcome:
    """The runs of all scenes together."""
    for part in parts:
        if isinstance(part, str):
            return Outcome(None, part)
    return Outcome(Sums.joined([part for part in parts if isinstance(part, Sums)]))
