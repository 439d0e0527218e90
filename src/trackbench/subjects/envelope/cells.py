"""Cells of a map: the runs of the scenario at one point, and the decision that they allow.

A look extends the runs of a cell and decides again. Runs are stored until the map is finished, so that an
interrupted command goes on where it was.
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
    """Error probability of a map, divided among its cells, its trackers and the interim looks at the results."""

    error: float
    """Probability that at least one cell of the map is decided wrongly, for at least one tracker."""
    tests: int
    """Planned number of cells, multiplied by the number of trackers."""
    numbers: tuple[int, ...]
    """Planned number of runs, or scenes, of a cell up to each look (interim test after more runs); cumulative."""

    def at(self, look: int) -> float:
        """Return the error probability of one look (counted from 0) at one cell of one tracker."""
        added = self.numbers[look] - (self.numbers[look - 1] if look else 0)
        return self.error / self.tests * added / self.numbers[-1]


class CellDecision(NamedTuple):
    """Decision whether a requirement holds in a cell, made at a look: an interim test after more runs."""

    state: State
    interval: Interval
    low: float | None
    """One-sided lower bound of the value; ``high`` is the upper bound. None where no bound is calibrated."""
    high: float | None

    @property
    def reason(self) -> str:
        """Reason why the value has no one-sided bound; empty where it has a bound."""
        return unbounded(self.interval)


def decide(interval: Interval, limit: float, direction: Direction, level: float, requirements: int = 1) -> CellDecision:
    """Decide whether a value holds or fails its limit, by one-sided bounds.

    Args:
        interval: value with what each run or scene so far adds to it.
        limit: limit of the requirement, in the unit of the value.
        direction: side of the limit on which the value must lie.
        level: error probability that the look may spend.
        requirements: number of requirements on the tracker; a failure of any one fails the cell.
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
    """Return a cell's state from its requirements' states: fails if any fails, holds if all hold, else undecided."""
    distinct = set(states)
    return "fails" if "fails" in distinct else "holds" if distinct == {"holds"} else "undecided"


class Extent(NamedTuple):
    """Number of scenes of a cell, and of runs of each scene."""

    scenes: int
    runs: int

    def blocks_beyond(self, done: Extent, largest: int) -> list[BlockRuns]:
        """Return the runs of this extent that ``done`` does not have, in blocks of at most ``largest`` runs."""
        pieces = []
        for scene in range(self.scenes):
            first = done.runs if scene < done.scenes else 0
            starts = range(first, self.runs, largest)
            pieces += [BlockRuns(scene, range(start, min(start + largest, self.runs))) for start in starts]
        return pieces

    @property
    def parts(self) -> int:
        """Number of runs in all scenes together."""
        return self.scenes * self.runs


@dataclass
class Runs:
    """Monte-Carlo runs of one tracker in a cell, with the sums from which metrics are computed."""

    sums: MetricSums = field(default_factory=dict)
    scene: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Scene number of each run, ``(runs,)``, in the order in which the runs were made."""
    run: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Number of each run in its scene, ``(runs,)``."""

    def with_blocks(self, sums: MetricSums, pieces: Sequence[BlockRuns], metrics: Sequence[Metric]) -> Runs:
        """Return a copy that also holds the runs of ``pieces``, whose metrics have the sums ``sums``."""
        scene = np.concatenate([np.full(len(piece.runs), piece.scene) for piece in pieces])
        run = np.concatenate([np.array(piece.runs) for piece in pieces])
        merged = merge_sums([self.sums, sums], metrics) if self.sums else sums
        return Runs(merged, np.concatenate([self.scene, scene]), np.concatenate([self.run, run]))

    def evaluated(self, metrics: Sequence[Metric], claim: Population) -> Evaluation:
        """Return the value of each metric, with the contribution of each independent part.

        A part is a scene for ``traffic like these``, else the runs with the same number in all scenes.
        """
        if claim == "traffic like these":
            return evaluate(self.sums, self.scene, metrics)
        evaluation = evaluate(self.sums, np.zeros_like(self.scene), metrics)
        intervals = {path: _by_repetition(interval, self.run) for path, interval in evaluation.intervals.items()}
        return replace(evaluation, intervals=intervals)


def _by_repetition(interval: Interval, run: Indices) -> Interval:
    """Average the influences of the runs with the same number in all scenes: only these groups are independent."""
    if len(interval.influence) != len(run) or run[-1] + 1 == len(run):
        return interval
    number = np.bincount(run)
    weight = None if interval.weight is None else np.bincount(run, interval.weight).astype(float)
    return interval._replace(influence=np.bincount(run, interval.influence) / number, weight=weight)


class LookResult(NamedTuple):
    """Result of the runs that a look (interim test) adds to a cell: metric sums and failures, by tracker name."""

    sums: dict[str, MetricSums]
    failures: dict[str, Failure]
    measurements: bytes
    """Hash of the measurements of these runs."""


def requirements_of(loaded: Scenario) -> list[ClaimedLimit]:
    """Return the expectations of the scenario as limits on metrics, by which cells are decided.

    Raises:
        InputError: there is no expectation, or its metric has no interval or cannot be repeated.
    """
    config = loaded.config
    if not config.expect:
        message = "an envelope needs a requirement, such as {tracker: ekf, metric: position_rmse, below: 0.5}"
        raise loaded.locate(InputError(message, key="expect"))
    fields = by_path(config.sensors, config.own_metrics, config.properties)
    return [_requirement(loaded, fields, number, item) for number, item in enumerate(config.expect)]


def _requirement(loaded: Scenario, fields: Mapping[str, Field], number: int, item: Expectation) -> ClaimedLimit:
    if item.metric in TIMES:
        message = f"{item.metric} changes each time that it is measured, so no claim on it could be repeated"
        raise loaded.locate(InputError(message, key=f"expect.{number}.metric"))
    direction: Direction = "above" if item.below is None else "below"
    limit = item.above if item.below is None else item.below
    if limit is None:
        key, what = ("is", "a word") if item.better_than is None else ("better_than", "a comparison")
        message = f"is {what}, but an envelope needs a limit: write below or above"
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
    """Return settings and truth for the runs of a cell, with coverage and the metrics of its requirements alone.

    Raises:
        InputError: a requirement is on a metric that has no interval.
    """
    work = work_of(loaded, truths, isolation, engine)
    required = {item.metric for item in requirements}
    metrics = [metric for metric in work.metrics if required & _paths(metric, work)]
    paths = frozenset[str]().union(*(_paths(metric, work) for metric in metrics))
    for number, item in enumerate(loaded.config.expect):
        if item.metric not in paths:
            message = f"{item.metric} is not a mean over runs, so it cannot decide a cell"
            raise loaded.locate(InputError(message, key=f"expect.{number}.metric"))
    metrics += [metric for metric in work.metrics if metric.name == "coverage" and metric not in metrics]
    return replace(work, metrics=tuple(metrics), recorded_run=-1, driven_twice=None)


def _paths(metric: Metric, work: Work) -> frozenset[str]:
    sensors = work.sensors if metric.per_sensor else ("",)
    return frozenset(metric.path.replace("<sensor>", sensor) for sensor in sensors)


def make_runs(work: Work, names: Collection[str], pieces: Sequence[BlockRuns]) -> LookResult:
    """Simulate the blocks ``pieces`` of a cell's runs for the trackers in ``names``; any process can call it."""
    work = replace(work, trackers={name: entry for name, entry in work.trackers.items() if name in names})
    blocks = [block for group in work.groups(pieces) for block in run_blocks(work, group)]
    failures, outcomes = failures_and_outcomes(work.trackers, blocks)
    sums = {name: merge_sums([item.sums for item in items], work.metrics) for name, items in outcomes.items()}
    digest = hashlib.sha256(b"".join(digest for block in blocks for digest in block.digests)).digest()
    return LookResult(sums, failures, digest)


def coverage_of(runs: Runs, claim: Population) -> Interval | None:
    """Return the share of expected estimates that a tracker gave; None with hidden identities or none expected."""
    scores = runs.sums.get(ESTIMATES.name)
    if scores is None or not scores.due.sum() > 0:
        return None
    share = ratio(scores.per_run[ERROR["given"]], scores.due, at_least=0.0, at_most=1.0)
    return clustered(share, runs.scene) if claim == "traffic like these" else _by_repetition(share, runs.run)


class Store:
    """Folder with a file for each look (interim test after more runs) at each cell.

    Args:
        folder: path of the folder; None stores nothing.
        signature: hash of all that determines the runs; it enters the names of the files.
    """

    def __init__(self, folder: Path | None, signature: str) -> None:
        self._folder, self._signature = folder, signature
        self.loaded_looks = 0
        """Number of looks whose results were read from the folder so far."""

    def load(self, point: Point, look: int) -> Any:
        """Return the stored result of the interim look ``look`` at a cell; None without one, or if it is damaged."""
        if self._folder is None:
            return None
        try:
            content = pickle.loads(self._file(self._folder, point, look).read_bytes())
        except Exception:
            return None
        self.loaded_looks += 1
        return content

    def save(self, point: Point, look: int, content: Any) -> None:
        """Store the result of a look at a cell; the file is written whole or not at all.

        Raises:
            OutputError: the file cannot be written.
        """
        if self._folder is None:
            return
        pickled, file = pickle.dumps(content), self._file(self._folder, point, look)
        try:
            try:
                write_whole(file, pickled)
            except FileNotFoundError:
                # Another command with the same map may have ended meanwhile and removed the folder.
                write_whole(file, pickled)
        except OSError as error:
            raise OutputError(f"cannot write {self._folder}: {error.strerror or error}") from error

    def _file(self, folder: Path, point: Point, look: int) -> Path:
        name = hashlib.sha256(f"{self._signature} {point!r}".encode()).hexdigest()[:24]
        return folder / f"{name}-{look}"
