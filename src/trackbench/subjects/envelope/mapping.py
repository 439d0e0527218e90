"""The work on a map: runs in each cell until it is decided or its budget is spent, then new cells near the border.

A look is one round of runs in a cell, after which it is decided whether each tracker holds, fails or stays undecided.
"""

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
from trackbench.subjects.envelope.axes import MapAxis, Point, Value, halfway_point, start_points
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

#: State of a cell for each tracker, by tracker name.
States = Mapping[str, str]


def refine(axes: Sequence[MapAxis], states: Mapping[Point, States], max_points: int, resolution: float) -> list[Point]:
    """Return new points half way between neighbours that differ in a tracker's state, the widest gaps first.

    Args:
        axes: axes of the map.
        states: states of each point, by tracker name.
        max_points: largest number of points to return.
        resolution: distance of two neighbours, as a share of the axis, at which no point is put between them any more.
    """
    gaps: dict[Point, float] = {}
    for a, b, gap in _neighbours(axes, states):
        # Some tracker's border may lie between the two, but where both are undecided.
        if states[a] != states[b]:
            point = halfway_point(axes, a, b, resolution)
            if point is not None and point not in states:
                gaps[point] = max(gaps.get(point, 0.0), gap)
    return sorted(gaps, key=lambda point: -gaps[point])[: max(0, max_points)]


def _neighbours(axes: Sequence[MapAxis], points: Mapping[Point, States]) -> Iterator[tuple[Point, Point, float]]:
    """Yield neighbours that differ in one continuous axis alone, and their distance as a share of that axis."""
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

#: Number of cells worked on at once: enough for the processes of a machine, and few enough for its memory.
AHEAD = 16
#: Largest number of scenarios whose truth stays in memory.
CACHED_TRUTHS = 4
NO_RUNS = Extent(0, 0)


@dataclass
class TrackerCell:
    """Runs of one tracker in a cell, and the decisions whether its requirements hold."""

    runs: Runs = field(default_factory=Runs)
    extent: Extent = NO_RUNS
    looks: int = 0
    decisions: tuple[CellDecision | None, ...] = ()
    """Decision on each requirement, in the order of the scenario; None where the metric has no value."""
    coverage: CellDecision | None = None
    """Decision on the share of estimates that were given; None where the scenario requires no share."""
    state: State = "undecided"
    cause: str = ""
    """Reason other than a limit why the tracker fails or is undecided; empty where there is none."""
    failed: bool = False
    """Whether the tracker broke down, so that it has no further runs."""


@dataclass
class MapCell:
    """Point of the map, with each tracker's runs there and its state: holds, fails or undecided."""

    point: Point
    loaded: Scenario
    trackers: dict[str, TrackerCell]
    """Trackers that have a requirement, by name."""
    added: bool = False
    """Whether the cell was added near a border; False for a cell of the grid from which the map starts."""
    measurements: list[bytes] = field(default_factory=list)
    """One hash for each look (interim test): of the measurements of the runs that the look added."""
    metrics: tuple[Metric, ...] = ()
    """Metrics by which the cell's runs are scored."""

    @property
    def states(self) -> dict[str, State]:
        return {name: tracker.state for name, tracker in self.trackers.items()}

    @property
    def undecided(self) -> list[str]:
        """Names of the trackers of which it is not decided yet whether their requirement holds in the cell."""
        return [name for name, tracker in self.trackers.items() if tracker.state == "undecided"]


class _Look(NamedTuple):
    """Look at a cell, begun and not finished: the cell's undecided trackers, and the blocks of runs to make."""

    cell: MapCell
    names: list[str]
    work: Work
    pieces: list[BlockRuns]
    stored: LookResult | None
    """Runs that an interrupted command stored; None where there are none."""


class EnvelopeMap:
    """Cells of a map, and the work that makes and decides them.

    The ``store`` keeps finished looks, so that an interrupted command goes on where it was.
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
        """Groups of points that have no cells, since these would be copies of other cells."""
        self.engine = ""
        """Name of the engine that computed the cells; empty before the first look."""
        self.executor, self.isolation, self.engine_choice = executor, isolation, engine
        self._store = store or Store(None, "")
        numbers = tuple(extent.parts for extent in task.extents)
        self._spending = Spending(1.0 - task.config.confidence, task.config.cells * len(task.trackers), numbers)
        self._truths: OrderedDict[str, list[LoadedTruth]] = OrderedDict()

    def make(self, progress: NotedProgress = no_progress) -> None:
        """Simulate the runs of all cells, decide the cells, and add cells near the border.

        Args:
            progress: called with the number of decided cells, the number of all cells and a note.

        Raises:
            InputError: the scenario is invalid at a cell.
            TrackbenchError: the processes that make the runs died.
        """
        config, trackers = self.task.config, self.task.trackers
        points, added = start_points(self.task.axes, config, self.task.base), False
        if not (points := self._without_copies(points)):
            message = f"no cell of the map differs from another: {self.absent[0].reason}"
            raise self.task.loaded.locate(InputError(message, key="envelope.axes"))
        while points:
            cells = {
                point: MapCell(point, self.task.scenario_at(point), {name: TrackerCell() for name in trackers}, added)
                for point in points
            }
            self.cells |= cells
            for look, extent in enumerate(self.task.extents):
                self._make_look([*cells.values()], look, extent, progress)
            states = {point: cell.states for point, cell in self.cells.items()}
            remaining = config.cells - len(self.cells)
            points = self._without_copies(refine(self.task.axes, states, remaining, config.resolution))
            added = True
        log.info("%d looks were there already", self._store.loaded_looks)

    def _without_copies(self, points: Sequence[Point]) -> list[Point]:
        """Return the points whose cells are no copies of others; note the absent points."""
        absent = {point: self.task.absent_at(point) for point in points}
        for item in absent.values():
            if item is not None and item not in self.absent:
                self.absent.append(item)
        return [point for point in points if absent[point] is None]

    def _make_look(self, cells: Sequence[MapCell], look: int, extent: Extent, progress: NotedProgress) -> None:
        """Extend the runs of the cells that are undecided, and decide them anew."""
        waiting = [cell for cell in cells if cell.undecided]
        for first in range(0, len(waiting), AHEAD):
            begun = [self._begin_look(cell, look, extent) for cell in waiting[first : first + AHEAD]]
            # Only scenes that need new runs are sent to another process.
            calls = [
                (item.work.of_scenes({piece.scene for piece in item.pieces}), item.names, item.pieces)
                for item in begun
                if item.stored is None
            ]
            results = self.executor.map(make_runs, calls, own_folder(self.task.loaded))
            for item in begun:
                self._finish_look(item, next(results) if item.stored is None else item.stored, look, extent, progress)

    def _begin_look(self, cell: MapCell, look: int, extent: Extent) -> _Look:
        names = cell.undecided
        # An undecided tracker took part in every earlier look.
        done = self.task.extents[look - 1] if look else NO_RUNS
        work = self.work(cell.loaded, extent)
        cell.metrics = work.metrics
        # A world may have another number of scenes.
        extent = extent._replace(scenes=len(work.scenes))
        objects = max(1, *(len(scene.truth.ids) for scene in work.scenes))
        pieces = extent.blocks_beyond(done, max(1, LARGEST_BATCH // objects))
        return _Look(cell, names, work, pieces, self._store.load(cell.point, look))

    def work(self, loaded: Scenario, extent: Extent) -> Work:
        """Return settings and truth for a cell's runs; for a claim on traffic ``extent`` has the number of scenes."""
        if self.task.config.claim == "traffic like these":
            truth = loaded.config.truth.model_copy(update={"seeds": extent.scenes})
            loaded = replace(loaded, config=loaded.config.model_copy(update={"truth": truth}))
        key = truth_key(loaded)
        if key not in self._truths:
            self._truths[key] = truths_of(loaded, executor=self.executor)
            while len(self._truths) > CACHED_TRUTHS:
                self._truths.popitem(last=False)
        work = work_of_cell(loaded, self._truths[key], self.task.requirements, self.isolation, self.engine_choice)
        self.engine = work.engine
        return work

    def _finish_look(self, begun: _Look, result: LookResult, look: int, size: Extent, progress: NotedProgress) -> None:
        """Add the runs of a look to its cell, and decide the cell."""
        cell = begun.cell
        if begun.stored is None:
            self._store.save(cell.point, look, result)
        cell.measurements.append(result.measurements)
        for name in begun.names:
            tracker = cell.trackers[name]
            if name in result.failures:
                tracker.state, tracker.cause, tracker.failed = "fails", str(result.failures[name]), True
                continue
            tracker.runs = tracker.runs.with_blocks(result.sums[name], begun.pieces, begun.work.metrics)
            tracker.extent, tracker.looks = size, look + 1
        for name in cell.undecided:
            self._decide(cell, name, begun.work.metrics, begun.work.min_coverage)
        decided = sum(not item.undecided for item in self.cells.values())
        progress(decided, len(self.cells), f"{len(self.cells) - decided} open")

    def _decide(self, cell: MapCell, name: str, metrics: Sequence[Metric], min_coverage: float) -> None:
        tracker = cell.trackers[name]
        requirements = self.task.requirements_on(name)
        evaluation = tracker.runs.evaluated(metrics, self.task.config.claim)
        coverage = coverage_of(tracker.runs, self.task.config.claim) if min_coverage else None
        # Coverage is one more requirement, by which the cell may fail.
        number = len(requirements) + (coverage is not None)
        tracker.decisions = tuple(self._decision(item, evaluation, tracker.looks, number) for item in requirements)
        reasons = [
            decision.reason if decision else _missing_value_reason(evaluation, item.metric)
            for item, decision in zip(requirements, tracker.decisions, strict=True)
        ]
        tracker.cause = "; ".join(dict.fromkeys(reason for reason in reasons if reason))
        tracker.state = joint_state(item.state if item else "undecided" for item in tracker.decisions)
        if coverage is not None:
            level = self._spending.at(tracker.looks - 1)
            tracker.coverage = decide(coverage, min_coverage, "above", level, number)
            joint = joint_state([tracker.state, tracker.coverage.state])
            if coverage.value < min_coverage and joint != tracker.state:
                tracker.state, tracker.cause = joint, _missing_estimates_text(tracker.coverage, min_coverage)

    def _decision(self, item: ClaimedLimit, evaluation: Evaluation, looks: int, number: int) -> CellDecision | None:
        interval = evaluation.intervals.get(item.metric)
        if interval is None:
            return None
        return decide(interval, item.limit, item.direction, self._spending.at(looks - 1), number)


def _missing_value_reason(evaluation: Evaluation, path: str) -> str:
    # A metric with several statistics has one reason, at the metric's name.
    value = evaluation.values.get(path) or evaluation.values.get(path.rpartition(".")[0])
    return (value and value.reason) or ""


def _missing_estimates_text(coverage: CellDecision, limit: float) -> str:
    missing = f"{100 * (1 - coverage.interval.value):.2g} % of the estimates are missing"
    return missing if coverage.state == "fails" else f"{missing}, not shown to be more than {100 * (1 - limit):.2g} %"
