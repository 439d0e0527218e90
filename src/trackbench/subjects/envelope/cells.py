"""A cell of the map: the scenario at one point, the runs that were made there, and what they decide.

Its runs are kept until the map is finished, so that the same command goes on where it was interrupted.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.errors import InputError, OutputError
from trackbench.base.files import write_whole
from trackbench.base.types import Indices
from trackbench.compare.comparison import TIMES
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName
from trackbench.metrics import Evaluation, Metric, evaluate, merge_sums
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import MetricSums
from trackbench.metrics.intervals import Interval, clustered, ratio
from trackbench.metrics.protocol import Field
from trackbench.metrics.registry import by_path
from trackbench.metrics.sums import ERROR
from trackbench.results import Failure
from trackbench.runner.block import failures_and_outcomes
from trackbench.runner.loop import run_blocks
from trackbench.runner.work import BlockRuns, Work, work_of
from trackbench.scenario import Scenario
from trackbench.scenario.keys import Expectation
from trackbench.subjects.envelope.axes import Point
from trackbench.subjects.envelope.bounds import bound, unbounded
from trackbench.subjects.envelope.claim import ClaimedLimit, Direction, Population, State
from trackbench.truth import LoadedTruth


class Spending(NamedTuple):
    """The error of a map, shared by its cells, trackers and looks."""

    error: float
    """That any cell is decided wrongly, for any tracker."""
    tests: int
    """Cells times trackers, as planned."""
    numbers: tuple[int, ...]
    """Of runs, or scenes, of a cell at each look, as planned."""

    def at(self, look: int) -> float:
        """What a look, counted from 0, may spend."""
        added = self.numbers[look] - (self.numbers[look - 1] if look else 0)
        return self.error / self.tests * added / self.numbers[-1]


class CellDecision(NamedTuple):
    """A requirement in a cell after a look."""

    state: State
    interval: Interval
    low: float | None
    """One-sided bounds of the value, each at the level of what it would show; None where there is none."""
    high: float | None

    @property
    def reason(self) -> str:
        """Why there is no bound; empty where there is one."""
        return unbounded(self.interval)


def decide(interval: Interval, limit: float, direction: Direction, level: float, requirements: int = 1) -> CellDecision:
    """Hold a value against its limit.

    Args:
        interval: of the runs or scenes so far.
        limit: that it has to be below or above.
        direction: which of these.
        level: what the look may spend.
        requirements: of the cell.
    """
    below = direction == "below"
    low = bound(interval, level / requirements if below else level, "lower")
    high = bound(interval, level if below else level / requirements, "upper")
    state: State = "undecided"
    if high is not None and high < limit:
        state = "holds" if below else "fails"
    elif low is not None and low > limit:
        state = "fails" if below else "holds"
    return CellDecision(state, interval, low, high)


def joint_state(states: Iterable[State]) -> State:
    """The state of a cell from those of all its requirements."""
    distinct = set(states)
    return "fails" if "fails" in distinct else "holds" if distinct == {"holds"} else "undecided"


class Extent(NamedTuple):
    """How far the runs of a cell go: runs of each of its scenes."""

    scenes: int
    runs: int

    def blocks_beyond(self, done: Extent, largest: int) -> list[BlockRuns]:
        """The runs that are missing from what was done, in blocks of at most so many."""
        pieces = []
        for scene in range(self.scenes):
            first = done.runs if scene < done.scenes else 0
            starts = range(first, self.runs, largest)
            pieces += [BlockRuns(scene, range(start, min(start + largest, self.runs))) for start in starts]
        return pieces

    @property
    def parts(self) -> int:
        """Number of runs of all scenes."""
        return self.scenes * self.runs


@dataclass
class Runs:
    """What the runs of one tracker in a cell left."""

    sums: MetricSums = field(default_factory=dict)
    scene: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """``(runs,)`` the scene of each run, in the order in which they were made."""
    run: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """``(runs,)`` its number in the scene."""

    def with_blocks(self, sums: MetricSums, pieces: Sequence[BlockRuns], metrics: Sequence[Metric]) -> Runs:
        """With the runs of some more blocks."""
        scene = np.concatenate([np.full(len(piece.runs), piece.scene) for piece in pieces])
        run = np.concatenate([np.array(piece.runs) for piece in pieces])
        whole = merge_sums([self.sums, sums], metrics) if self.sums else sums
        return Runs(whole, np.concatenate([self.scene, scene]), np.concatenate([self.run, run]))

    def evaluated(self, metrics: Sequence[Metric], claim: Population) -> Evaluation:
        """Each metric, with what each independent part adds: a scene, or the run of one number in all scenes."""
        if claim == "traffic like these":
            return evaluate(self.sums, self.scene, metrics)
        evaluation = evaluate(self.sums, np.zeros_like(self.scene), metrics)
        intervals = {path: _by_repetition(interval, self.run) for path, interval in evaluation.intervals.items()}
        return replace(evaluation, intervals=intervals)


def _by_repetition(interval: Interval, run: Indices) -> Interval:
    """The scenes stay and runs repeat: the run of one number in all scenes is one independent part."""
    if len(interval.influence) != len(run) or run[-1] + 1 == len(run):
        return interval
    number = np.bincount(run)
    weight = None if interval.weight is None else np.bincount(run, interval.weight).astype(float)
    return interval._replace(influence=np.bincount(run, interval.influence) / number, weight=weight)


class LookResult(NamedTuple):
    """What some new runs of a cell left, by tracker."""

    sums: dict[str, MetricSums]
    failures: dict[str, Failure]
    measurements: bytes
    """A hash of them."""


def requirements_of(loaded: Scenario) -> list[ClaimedLimit]:
    """Return what the scenario expects, as limits by which its cells are judged.

    Raises:
        InputError: it expects nothing, or something that no interval tells, or no other run can repeat.
    """
    config = loaded.config
    if not config.expect:
        message = "an envelope needs a requirement, such as {tracker: ekf, metric: position_rmse, below: 0.5}"
        raise loaded.locate(InputError(message, key="expect"))
    fields = by_path(config.sensors, config.own_metrics, config.properties)
    return [_requirement(loaded, fields, number, item) for number, item in enumerate(config.expect)]


def _requirement(loaded: Scenario, fields: Mapping[str, Field], number: int, item: Expectation) -> ClaimedLimit:
    if item.metric in TIMES:
        message = f"{item.metric} is another each time that it is measured, so that no claim on it could be repeated"
        raise loaded.locate(InputError(message, key=f"expect.{number}.metric"))
    direction: Direction = "above" if item.below is None else "below"
    limit = item.above if item.below is None else item.below
    if limit is None:
        key, what = ("is", "a word") if item.better_than is None else ("better_than", "a comparison")
        message = f"is {what}, by which no cell is decided: an envelope takes below and above"
        raise loaded.locate(InputError(message, key=f"expect.{number}.{key}"))
    unit = fields[item.metric].unit
    return ClaimedLimit(tracker=item.tracker, metric=item.metric, unit=unit, direction=direction, limit=limit)


def work_of_cell(
    loaded: Scenario,
    truths: Sequence[LoadedTruth],
    requirements: Sequence[ClaimedLimit],
    isolation: Isolation = ISOLATED,
    engine: EngineName = "auto",
) -> Work:
    """What the runs of a cell need; of the metrics those that it is judged by, and coverage.

    Raises:
        InputError: a requirement is on what has no interval.
    """
    work = work_of(loaded, truths, isolation, engine)
    wanted = {item.metric for item in requirements}
    metrics = [metric for metric in work.metrics if wanted & _paths(metric, work)]
    paths = frozenset[str]().union(*(_paths(metric, work) for metric in metrics))
    for number, item in enumerate(loaded.config.expect):
        if item.metric not in paths:
            message = f"{item.metric} is no mean over runs, so that no cell can be decided by it"
            raise loaded.locate(InputError(message, key=f"expect.{number}.metric"))
    metrics += [metric for metric in work.metrics if metric.name == "coverage" and metric not in metrics]
    return replace(work, metrics=tuple(metrics), recorded_run=-1, driven_twice=None)


def _paths(metric: Metric, work: Work) -> frozenset[str]:
    """What expectations may name that is a mean over runs."""
    sensors = work.sensors if metric.per_sensor else ("",)
    return frozenset(metric.path.replace("<sensor>", sensor) for sensor in sensors)


def make_runs(work: Work, names: Collection[str], pieces: Sequence[BlockRuns]) -> LookResult:
    """The runs of some blocks of a cell, for some of its trackers; called in any process."""
    work = replace(work, trackers={name: entry for name, entry in work.trackers.items() if name in names})
    blocks = [block for group in work.groups(pieces) for block in run_blocks(work, group)]
    failures, outcomes = failures_and_outcomes(work.trackers, blocks)
    sums = {name: merge_sums([item.sums for item in items], work.metrics) for name, items in outcomes.items()}
    digest = hashlib.sha256(b"".join(each for block in blocks for each in block.digests)).digest()
    return LookResult(sums, failures, digest)


def coverage_of(runs: Runs, claim: Population) -> Interval | None:
    """Share of the estimates that are due and were given, with what each independent part adds; None with hidden
    identities, and where none is due."""
    scores = runs.sums.get(ESTIMATES.name)
    if scores is None or not scores.due.sum() > 0:
        return None
    share = ratio(scores.per_run[ERROR["given"]], scores.due, at_least=0.0, at_most=1.0)
    return clustered(share, runs.scene) if claim == "traffic like these" else _by_repetition(share, runs.run)


class Store:
    """A folder with a file for each look at each cell.

    Args:
        folder: None keeps nothing.
        signature: what determines the runs; the files of another one have other names.
    """

    def __init__(self, folder: Path | None, signature: str) -> None:
        self._folder, self._signature = folder, signature
        self.taken = 0
        """Looks that were there already."""

    def load(self, point: Point, look: int) -> Any:
        """Return what a look at a cell left; None where it was not made, or its file is damaged."""
        if self._folder is None:
            return None
        try:
            content = pickle.loads(self._file(self._folder, point, look).read_bytes())
        except Exception:
            return None
        self.taken += 1
        return content

    def save(self, point: Point, look: int, content: Any) -> None:
        """Keep what a look at a cell left; the file is there whole, or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        if self._folder is None:
            return
        whole, file = pickle.dumps(content), self._file(self._folder, point, look)
        try:
            try:
                write_whole(file, whole)
            except FileNotFoundError:
                # Another command with the same map has ended, and removed the folder.
                write_whole(file, whole)
        except OSError as error:
            raise OutputError(f"cannot write {self._folder}: {error.strerror or error}") from error

    def _file(self, folder: Path, point: Point, look: int) -> Path:
        name = hashlib.sha256(f"{self._signature} {point!r}".encode()).hexdigest()[:24]
        return folder / f"{name}-{look}"
