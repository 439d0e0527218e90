"""The trials of one tracker: all on identical measurements, as many in one batch as differ in noise levels alone."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from trackbench.base.execution import Task
from trackbench.base.types import Indices, Progress, no_progress
from trackbench.driving.faults import fault_of
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName, chosen
from trackbench.engine.equations import EngineUsed, joined
from trackbench.metrics import Metric
from trackbench.metrics.traffic import TRACK_METRICS, TRACKS, run_sums
from trackbench.results import Failure
from trackbench.runner.block import run_block
from trackbench.runner.hidden_run import TrafficScores
from trackbench.runner.labelled_run import LabelledOutcome
from trackbench.runner.work import LARGEST_BATCH, BlockRuns, Work, work_of
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.subjects.tuning.entry import Entry, Values, combined, entry_with, varies_in_batch
from trackbench.subjects.tuning.labelled import PackedAvailability, score_labelled
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


#: The sums of some runs of one scene, or why there are none; what is counted; what computed the tracker.
_StartPiece = tuple[Sums | str, PackedAvailability | None, EngineUsed | None]


class _Scene(NamedTuple):
    """What all trials of a scene share."""

    work: Work
    counted: PackedAvailability | None
    metric: Metric | None
    """That is summed beside the usual measures, where it is none of these."""
    measure: str
    """Of tracks, that is kept beside the usual ones."""


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
        measure: str = "gospa",
    ) -> None:
        self.benches, self.tracker, self.parameters = benches, tracker, parameters
        self._executor = executor
        self._metric, self._measure = metric, measure
        work = [work_of(bench.scenario, bench.truths, isolation) for bench in benches]
        self.engine = chosen(engine, trials * sum(item.steps for item in work))
        self._work = [replace(item, engine=self.engine) for item in work]

    def scenes(self, bench: int) -> Indices:
        """``(runs,)`` number of the scene of each run of a scenario."""
        return self._work[bench].scene_of_run

    @property
    def start(self) -> list[Outcome]:
        """What the tracker gives as it is, in each scenario."""
        return [start.outcome for start in self._start]

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computes the tracker; None of one that is not built in."""
        return joined(start.engine for start in self._start if start.engine is not None)

    @cached_property
    def _start(self) -> list[_Start]:
        submitted = []
        for bench, work in zip(self.benches, self._work, strict=True):
            tasks = self._tasks(_start_hidden if bench.hidden else _start_labelled, bench, work)
            entry = bench.scenario.config.trackers[self.tracker]
            submitted.append(
                [
                    [self._executor.submit(task, piece, entry) for piece in _pieces(work, scene, 1)]
                    for scene, task in enumerate(tasks)
                ]
            )
        starts = []
        for scenes in submitted:
            results: list[list[_StartPiece]] = [[piece.result() for piece in pieces] for pieces in scenes]
            counted = []
            for pieces in results:
                masks = [piece[1] for piece in pieces if piece[1] is not None]
                counted.append(PackedAvailability.joined(masks) if len(masks) == len(pieces) else None)
            every = [piece for pieces in results for piece in pieces]
            engine = joined(piece[2] for piece in every if piece[2] is not None)
            starts.append(_Start(_joined([piece[0] for piece in every]), tuple(counted), engine))
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
            tasks = self._tasks(_hidden if bench.hidden else _labelled, bench, work, self._start[number].counted)
            for batch in self._batches(bench.scenario, points, [outcomes[number] for outcomes in sums]):
                for scene, task in enumerate(tasks):
                    for piece in _pieces(work, scene, len(batch.trials)):
                        pending.append((number, batch, self._executor.submit(task, piece, batch)))
        for done, (number, batch, future) in enumerate(pending):
            progress(done, len(pending))
            for trial, outcome in zip(batch.trials, future.result(), strict=True):
                sums[trial][number].append(outcome)
        progress(len(pending), len(pending))
        return [[_joined(parts) for parts in outcomes] for outcomes in sums]

    def _tasks(
        self, make: Callable[..., Any], bench: Bench, work: Work, counted: Sequence[PackedAvailability | None] = ()
    ) -> list[Task]:
        """A function for each scene, and what its calls share."""
        constants = [
            _Scene(work.of_scene(scene), counted[scene] if counted else None, self._metric, self._measure)
            for scene in range(len(work.scenes))
        ]
        return [Task(make, constant, own_folder(bench.scenario)) for constant in constants]

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


def _start_labelled(scene: _Scene, piece: BlockRuns, entry: Entry) -> _StartPiece:
    try:
        (sums,), available, engine = score_labelled(scene.work, piece, entry)
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        return fault_of(error).cause, None, None
    return _with_metric(sums, scene, piece, entry), PackedAvailability.of(available), engine


def _start_hidden(scene: _Scene, piece: BlockRuns, entry: Entry) -> _StartPiece:
    """The sums of a trial that follows several objects from detections of hidden identities, or why there are none."""
    block = run_block(replace(scene.work, trackers={TRIAL: entry}), piece)
    scores, engine = block.outcomes[TRIAL], block.engines.get(TRIAL)
    if isinstance(scores, Failure):
        return scores.cause, None, engine
    assert isinstance(scores, TrafficScores)
    measures = {path: path for path in (*OF_TRACKS, scene.measure) if path in TRACK_METRICS}
    measures["prediction_score"] = "log_likelihood"
    values = scores.metrics[TRACKS.name]
    sums = Sums({name: run_sums(values, path) for path, name in measures.items()})
    return sums if scene.metric is None else replace(sums, metric=scene.metric, blocks=(scores.metrics,)), None, engine


def _with_metric(sums: Sums | str, scene: _Scene, piece: BlockRuns, entry: Entry) -> Sums | str:
    """With what the objective's metric sums of the same runs, as a run sums it."""
    if scene.metric is None or isinstance(sums, str):
        return sums
    metrics = metrics_of_trial(scene.metric)
    outcome = run_block(replace(scene.work, trackers={TRIAL: entry}, metrics=metrics), piece).outcomes[TRIAL]
    if isinstance(outcome, Failure):
        return outcome.cause
    assert isinstance(outcome, LabelledOutcome)
    return replace(sums, metric=scene.metric, blocks=(outcome.sums,))


def _labelled(scene: _Scene, piece: BlockRuns, batch: _Batch) -> list[Sums | str]:
    outcomes = zip(_together(scene, piece, batch), batch.entries, strict=True)
    return [_with_metric(sums, scene, piece, entry) for sums, entry in outcomes]


def _together(scene: _Scene, piece: BlockRuns, batch: _Batch) -> list[Sums | str]:
    """The usual measures of the trials of a batch; where the arithmetic of one fails, each by itself."""
    number, entry, work = len(batch.trials), batch.entries[0], scene.work
    if scene.counted is None:
        return ["the tracker fails as it is"] * number
    counted = scene.counted.of_runs(piece.runs).unpacked()
    size = len(work.scenes[piece.scene].truth.ids) * len(piece.runs)
    if number == 1:
        try:
            return [*score_labelled(work, piece, entry, 1, counted)[0]]
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:
            return [fault_of(error).cause]
    if isinstance(entry, FilterConfig) and batch.keys:
        # Trials come slowest.
        columns = {key: np.repeat(np.array([float(point[key]) for point in batch.points]), size) for key in batch.keys}
        entry = combined(entry, columns)
    try:
        return [*score_labelled(work, piece, entry, number, counted)[0]]
    except np.linalg.LinAlgError:
        return [_together(scene, piece, batch.part(slice(i, i + 1)))[0] for i in range(number)]


def _hidden(scene: _Scene, piece: BlockRuns, batch: _Batch) -> list[Sums | str]:
    """The trials of a batch, one after the other."""
    return [_start_hidden(scene, piece, entry)[0] for entry in batch.entries]


def _joined(parts: Sequence[Sums | str]) -> Outcome:
    """The runs of all scenes together."""
    for part in parts:
        if isinstance(part, str):
            return Outcome(None, part)
    return Outcome(Sums.joined([part for part in parts if isinstance(part, Sums)]))
