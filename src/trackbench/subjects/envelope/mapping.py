"""Makes the map: runs in each cell until it is decided or its budget is spent, then new cells near the border."""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.base.types import NotedProgress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName
from trackbench.metrics import Evaluation, Metric
from trackbench.runner.work import LARGEST_BATCH, BlockRuns, Work
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.scenario.truth import truths_of
from trackbench.subjects.envelope.axes import MapAxis, Point, Value, between, start_points
from trackbench.subjects.envelope.cells import (
    CellDecision,
    Extent,
    LookResult,
    Runs,
    Spending,
    Store,
    coverage_of,
    decide,
    joint_state,
    make_runs,
    work_of_cell,
)
from trackbench.subjects.envelope.claim import AbsentCells, ClaimedLimit, State
from trackbench.subjects.envelope.task import EnvelopeTask, truth_key
from trackbench.truth import LoadedTruth

#: By tracker, the state of a cell.
States = Mapping[str, str]


def refined(axes: Sequence[MapAxis], states: Mapping[Point, States], most: int, resolution: float) -> list[Point]:
    """New points half way between neighbours that differ in a state, those furthest apart first.

    Args:
        axes: of the map.
        states: of each point, by tracker.
        most: how many more cells there may be.
        resolution: share of an axis at which nothing is put between two points any more.
    """
    gaps: dict[Point, float] = {}
    for a, b, gap in _along_axes(axes, states):
        # Some tracker's border may lie between the two, but where both are undecided.
        if states[a] != states[b]:
            point = between(axes, a, b, resolution)
            if point is not None and point not in states:
                gaps[point] = max(gaps.get(point, 0.0), gap)
    return sorted(gaps, key=lambda point: -gaps[point])[: max(0, most)]


def _along_axes(axes: Sequence[MapAxis], points: Mapping[Point, States]) -> Iterator[tuple[Point, Point, float]]:
    """Yield neighbours that differ in one continuous axis alone, and how far they are apart, a share of the axis."""
    for number, axis in enumerate(axes):
        if not axis.continuous:
            continue
        lines: dict[tuple[Value, ...], list[Point]] = {}
        for point in points:
            lines.setdefault((*point[:number], *point[number + 1 :]), []).append(point)
        for line in lines.values():
            line.sort(key=lambda point: float(point[number]))
            for a, b in pairwise(line):
                yield a, b, abs(axis.share(a[number]) - axis.share(b[number]))


log = logging.getLogger(__name__)

#: So many cells are asked for at once: enough for the processes of a machine, and few enough for its memory.
AHEAD = 16
#: Truths of so many different scenarios are kept.
KEPT_TRUTHS = 4
NOTHING = Extent(0, 0)


@dataclass
class TrackerCell:
    """What is known of one tracker in a cell."""

    runs: Runs = field(default_factory=Runs)
    extent: Extent = NOTHING
    looks: int = 0
    judged: tuple[CellDecision | None, ...] = ()
    """By requirement, in the order of the scenario; None where there is no value."""
    coverage: CellDecision | None = None
    """Of the share of the estimates, held against the least of the scenario; None where it is not needed."""
    state: State = "undecided"
    cause: str = ""
    """Why it fails, or cannot be decided, where that is not a limit."""
    failed: bool = False
    """Whether it could not go on."""


@dataclass
class MapCell:
    """A point of the map, and what its trackers reached there."""

    point: Point
    loaded: Scenario
    trackers: dict[str, TrackerCell]
    """Those of which something is required."""
    added: bool = False
    """Whether it was put near a border, and was not where the map started."""
    measurements: list[bytes] = field(default_factory=list)
    """Of each look, the hash of the measurements of its runs."""
    metrics: tuple[Metric, ...] = ()
    """That its runs are scored by."""

    @property
    def states(self) -> dict[str, State]:
        """By tracker."""
        return {name: tracker.state for name, tracker in self.trackers.items()}

    @property
    def undecided(self) -> list[str]:
        """The trackers that are."""
        return [name for name, tracker in self.trackers.items() if tracker.state == "undecided"]


class _Look(NamedTuple):
    """A look at a cell that is under way."""

    cell: MapCell
    names: list[str]
    work: Work
    pieces: list[BlockRuns]
    kept: LookResult | None
    """The runs that an interrupted command left."""


class EnvelopeMap:
    """The cells of a map, as they are made.

    Args:
        task: what is mapped.
        executor: what makes the runs.
        isolation: how plug-ins are kept apart.
        engine: what computes.
        store: keeps what was made, so that an interrupted command goes on.
    """

    def __init__(
        self,
        task: EnvelopeTask,
        executor: Executor,
        isolation: Isolation = ISOLATED,
        engine: EngineName = "auto",
        store: Store | None = None,
    ) -> None:
        self.task = task
        self.cells: dict[Point, MapCell] = {}
        self.absent: list[AbsentCells] = []
        """Points that are no cells, since each would be a copy of another."""
        self.engine = ""
        """That computed the cells."""
        self.executor, self.isolation, self.engine_choice = executor, isolation, engine
        self._store = store or Store(None, "")
        numbers = tuple(extent.parts for extent in task.extents)
        self._spending = Spending(1.0 - task.config.confidence, task.config.cells * len(task.trackers), numbers)
        self._truths: OrderedDict[str, list[LoadedTruth]] = OrderedDict()

    def make(self, progress: NotedProgress = no_progress) -> None:
        """Make all cells.

        Args:
            progress: called with the number of cells that are done and of those that there are.

        Raises:
            InputError: a cell is no valid scenario.
            TrackbenchError: the processes that make the runs died.
        """
        config, trackers = self.task.config, self.task.trackers
        points, added = start_points(self.task.axes, config, self.task.base), False
        if not (points := self._present(points)):
            message = f"no cell of the map differs from another: {self.absent[0].reason}"
            raise self.task.loaded.locate(InputError(message, key="envelope.axes"))
        while points:
            cells = {
                point: MapCell(point, self.task.scenario_at(point), {name: TrackerCell() for name in trackers}, added)
                for point in points
            }
            self.cells |= cells
            for look, extent in enumerate(self.task.extents):
                self._look([*cells.values()], look, extent, progress)
            states = {point: cell.states for point, cell in self.cells.items()}
            left = config.cells - len(self.cells)
            points = self._present(refined(self.task.axes, states, left, config.resolution))
            added = True
        log.info("%d looks were there already", self._store.taken)

    def _present(self, points: Sequence[Point]) -> list[Point]:
        """The points that are cells; notes which are none."""
        absent = {point: self.task.absent_at(point) for point in points}
        for item in absent.values():
            if item is not None and item not in self.absent:
                self.absent.append(item)
        return [point for point in points if absent[point] is None]

    def _look(self, cells: Sequence[MapCell], look: int, extent: Extent, progress: NotedProgress) -> None:
        """Look at the undecided ones among some cells."""
        waiting = [cell for cell in cells if cell.undecided]
        for first in range(0, len(waiting), AHEAD):
            begun = [self._begun(cell, look, extent) for cell in waiting[first : first + AHEAD]]
            # Scenes that are done are not sent again.
            calls = [
                (item.work.of_scenes({piece.scene for piece in item.pieces}), item.names, item.pieces)
                for item in begun
                if item.kept is None
            ]
            made = self.executor.map(make_runs, calls, own_folder(self.task.loaded))
            for item in begun:
                self._end(item, next(made) if item.kept is None else item.kept, look, extent, progress)

    def _begun(self, cell: MapCell, look: int, extent: Extent) -> _Look:
        names = cell.undecided
        # All of them were at every look before.
        done = self.task.extents[look - 1] if look else NOTHING
        work = self.work(cell.loaded, extent)
        cell.metrics = work.metrics
        # A world may have another number of scenes.
        extent = extent._replace(scenes=len(work.scenes))
        objects = max(1, *(len(scene.truth.ids) for scene in work.scenes))
        pieces = extent.blocks_beyond(done, max(1, LARGEST_BATCH // objects))
        return _Look(cell, names, work, pieces, self._store.load(cell.point, look))

    def work(self, loaded: Scenario, extent: Extent) -> Work:
        """What the runs of a scenario need.

        Args:
            loaded: of a cell.
            extent: the scenes that there are, where traffic repeats.
        """
        if self.task.config.claim == "traffic like these":
            truth = loaded.config.truth.model_copy(update={"seeds": extent.scenes})
            loaded = replace(loaded, config=loaded.config.model_copy(update={"truth": truth}))
        key = truth_key(loaded)
        if key not in self._truths:
            self._truths[key] = truths_of(loaded, executor=self.executor)
            while len(self._truths) > KEPT_TRUTHS:
                self._truths.popitem(last=False)
        work = work_of_cell(loaded, self._truths[key], self.task.requirements, self.isolation, self.engine_choice)
        self.engine = work.engine
        return work

    def _end(self, begun: _Look, result: LookResult, look: int, extent: Extent, progress: NotedProgress) -> None:
        """Take in the runs of a look, and decide."""
        cell = begun.cell
        if begun.kept is None:
            self._store.save(cell.point, look, result)
        cell.measurements.append(result.measurements)
        for name in begun.names:
            tracker = cell.trackers[name]
            if name in result.failures:
                tracker.state, tracker.cause, tracker.failed = "fails", str(result.failures[name]), True
                continue
            tracker.runs = tracker.runs.with_blocks(result.sums[name], begun.pieces, begun.work.metrics)
            tracker.extent, tracker.looks = extent, look + 1
        for name in cell.undecided:
            self._decide(cell, name, begun.work.metrics, begun.work.min_coverage)
        decided = sum(not item.undecided for item in self.cells.values())
        progress(decided, len(self.cells), f"{len(self.cells) - decided} open")

    def _decide(self, cell: MapCell, name: str, metrics: Sequence[Metric], min_coverage: float) -> None:
        tracker = cell.trackers[name]
        requirements = self.task.of(name)
        own = tracker.runs.evaluated(metrics, self.task.config.claim)
        coverage = coverage_of(tracker.runs, self.task.config.claim) if min_coverage else None
        # It is one more requirement, by which the cell may fail.
        number = len(requirements) + (coverage is not None)
        tracker.judged = tuple(self._judged(item, own, tracker.looks, number) for item in requirements)
        reasons = [
            decision.reason if decision else _reason(own, item.metric)
            for item, decision in zip(requirements, tracker.judged, strict=True)
        ]
        tracker.cause = "; ".join(dict.fromkeys(reason for reason in reasons if reason))
        tracker.state = joint_state(item.state if item else "undecided" for item in tracker.judged)
        if coverage is not None:
            level = self._spending.at(tracker.looks - 1)
            tracker.coverage = decide(coverage, min_coverage, "above", level, number)
            worse = joint_state([tracker.state, tracker.coverage.state])
            if coverage.value < min_coverage and worse != tracker.state:
                tracker.state, tracker.cause = worse, _missing(tracker.coverage, min_coverage)

    def _judged(self, item: ClaimedLimit, own: Evaluation, looks: int, requirements: int) -> CellDecision | None:
        interval = own.intervals.get(item.metric)
        if interval is None:
            return None
        return decide(interval, item.limit, item.direction, self._spending.at(looks - 1), requirements)


def _reason(evaluation: Evaluation, path: str) -> str:
    """Why there is no value of a path; that of a statistic without any stands at its name."""
    value = evaluation.values.get(path) or evaluation.values.get(path.rpartition(".")[0])
    return (value and value.reason) or ""


def _missing(coverage: CellDecision, least: float) -> str:
    """What a coverage below the least says of a cell."""
    missing = f"{100 * (1 - coverage.interval.value):.2g} % of the estimates are missing"
    return missing if coverage.state == "fails" else f"{missing}, not shown to be more than {100 * (1 - least):.2g} %"
