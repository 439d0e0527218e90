"""Search for counter-examples: the nearest failing cells, each represented by its median failing run."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from trackbench.api.plan import Listener, RunPlan
from trackbench.api.run import run_scenarios
from trackbench.base.types import Array
from trackbench.metrics import evaluate
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.traffic import TRACKS, run_sums
from trackbench.results import Result
from trackbench.runner.estimate_records import run_sums_record
from trackbench.subjects.envelope.axes import MapAxis, Point, Value, point_distance
from trackbench.subjects.envelope.claim import Claim, ClaimCell, ClaimedLimit
from trackbench.subjects.envelope.counter_models import (
    BasePoint,
    CounterExample,
    CounterExamples,
    ShownExample,
    ShownRun,
)
from trackbench.subjects.envelope.counter_page import event_of, finding_on
from trackbench.subjects.envelope.mapping import EnvelopeMap, MapCell
from trackbench.subjects.envelope.task import changed_scenario


class FailingCell(NamedTuple):
    """Cell in which a tracker fails, with the axis and the side of the map towards which it lies."""

    tracker: str
    axis: str
    side: str
    cell: int
    """Index of the cell in ``Claim.cells``."""
    distance: float


def base_of(claim: Claim, tracker: str) -> BasePoint:
    """Return the point from which the distances of a tracker's failing cells are counted.

    It is the scenario's own point. If the nearest cell does not hold, it is the nearest cell that holds.
    """
    axes, scenario_point = claim.axes, claim.base_point
    state = _nearest(axes, scenario_point, claim.cells).trackers[tracker].state
    holding = [cell for cell in claim.cells if cell.trackers[tracker].state == "holds"]
    if state == "holds" or not holding:
        return BasePoint(tracker=tracker, point=list(scenario_point), note="")
    what = "fails" if state == "fails" else "is not shown to hold or to fail"
    note = f"the scenario {what}: distances are from the nearest cell that holds"
    return BasePoint(tracker=tracker, point=list(_nearest(axes, scenario_point, holding).at), note=note)


def nearest_failing(claim: Claim, base: BasePoint, most: int | None = None) -> list[FailingCell]:
    """Return the nearest failing cell towards each side of the map (end of an axis), the nearest first.

    A cell lies towards the side of the axis along which it is furthest from ``base``. A cell is left out if another
    failing cell is nearer along this axis and no further along any other: the other cell shows the failure already.

    Args:
        claim: claim of the map.
        base: point from which a tracker's distances are counted.
        most: largest number of cells; None for twice the number of axes.
    """
    failing = [number for number, cell in enumerate(claim.cells) if cell.trackers[base.tracker].state == "fails"]
    away = np.array(
        [
            [axis.distance(a, b) for axis, a, b in zip(claim.axes, base.at, claim.cells[number].at, strict=True)]
            for number in failing
        ]
    ).reshape(len(failing), len(claim.axes))
    failing_cells: dict[tuple[str, str], FailingCell] = {}
    for number, distances in zip(failing, away, strict=True):
        furthest = int(np.argmax(distances))
        if distances[furthest] == 0 or np.any(
            (away <= distances).all(axis=1) & (away[:, furthest] < distances[furthest])
        ):
            continue
        axis, cell = claim.axes[furthest], claim.cells[number]
        side, length = _side(base.at[furthest], cell.at[furthest]), point_distance(claim.axes, base.at, cell.at)
        if (axis.name, side) not in failing_cells or length < failing_cells[axis.name, side].distance:
            failing_cells[axis.name, side] = FailingCell(base.tracker, axis.name, side, number, length)
    nearest = sorted(failing_cells.values(), key=lambda failing: failing.distance)
    return nearest[: 2 * len(claim.axes) if most is None else most]


def _side(start: Value, value: Value) -> str:
    if isinstance(value, str) or isinstance(start, str):
        return str(value)
    return "high" if value > start else "low"


def _nearest(axes: tuple[MapAxis, ...], point: Point, cells: list[ClaimCell]) -> ClaimCell:
    return min(cells, key=lambda cell: point_distance(axes, point, cell.at))


#: Characters that are replaced in the name of a folder.
UNFIT = re.compile(r"[^A-Za-z0-9_.-]+")


class CounterMaker:
    """Work that makes the counter-examples of a finished map, with the map's executor, isolation and engine."""

    def __init__(self, envelope_map: EnvelopeMap, claim: Claim) -> None:
        self._map, self._claim, self._task = envelope_map, claim, envelope_map.task
        self._cells = [*envelope_map.cells.values()]
        self.shown: dict[str, ShownExample] = {}
        """Scenario and result of each counter-example, by folder name."""

    def make(self, most: int | None, listener: Listener) -> CounterExamples:
        """Find and record the counter-examples, at most ``most`` of each tracker; None for twice the number of axes."""
        bases = [base_of(self._claim, tracker) for tracker in self._claim.trackers]
        failing_cells = [failing for base in bases for failing in nearest_failing(self._claim, base, most)]
        findings: dict[str, str] = {}
        examples = []
        with listener.progress(f"counter-examples of {self._claim.scenario}", "examples") as advance:
            for number, failing in enumerate(failing_cells, 1):
                advance(number - 1, len(failing_cells))
                example = self._example(number, failing)
                if failing.tracker not in findings:
                    loaded = self.shown[example.folder].loaded
                    findings[failing.tracker] = finding_on(loaded, failing.tracker, self._map.executor)
                examples.append(example.model_copy(update={"finding": findings[failing.tracker]}))
        return CounterExamples(bases=bases, examples=examples)

    def _example(self, number: int, failing: FailingCell) -> CounterExample:
        cell, claimed = self._cells[failing.cell], self._claim.cells[failing.cell]
        limit = _failed_limit(self._claim, claimed, failing.tracker)
        requirement = None if limit is None else self._task.requirements[limit]
        shown = self._median_failing_run(cell, failing.tracker, requirement)
        folder = UNFIT.sub("-", f"{number}-{failing.tracker}-{failing.axis}-{failing.side}")
        result = self._run(folder, cell, failing.tracker, requirement, shown)
        metric = "" if requirement is None else requirement.metric
        return CounterExample(
            folder=folder,
            **failing._asdict(),
            limit=limit,
            shown=shown,
            event=event_of(result, failing.tracker, metric),
            finding="",
        )

    def _median_failing_run(self, cell: MapCell, tracker: str, requirement: ClaimedLimit | None) -> ShownRun:
        runs = cell.trackers[tracker].runs
        values = None if requirement is None else _run_values(cell, requirement)
        if requirement is None or values is None:
            return ShownRun(scene=0, run=0, value=None, beyond=None, runs=len(runs.run))
        order = np.argsort(values)
        beyond = [run for run in order if np.isfinite(values[run]) and requirement.excess(values[run]) >= 0]
        # The mean may be beyond the limit although no run is; then the run nearest to the limit is shown.
        nearest = order[np.nanargmax([requirement.excess(values[run]) for run in order])]
        middle = beyond[(len(beyond) - 1) // 2] if beyond else nearest
        return ShownRun(
            scene=int(runs.scene[middle]),
            run=int(runs.run[middle]),
            value=float(values[middle]),
            beyond=len(beyond),
            runs=len(values),
        )

    def _run(
        self, folder: str, cell: MapCell, tracker: str, requirement: ClaimedLimit | None, shown: ShownRun
    ) -> Result:
        """Repeat the runs of a cell, and keep the estimates of the run ``shown`` for the report and the recording."""
        extent = cell.trackers[tracker].extent
        changes = [f"recording.scene={shown.scene}", f"recording.run={shown.run}"]
        changes.append(f"monte_carlo.runs={max(1, extent.runs)}")
        if self._task.config.claim == "traffic like these":
            changes.append(f"truth.seeds={max(1, extent.scenes)}")
        loaded = changed_scenario(cell.loaded, changes, [tracker])
        plan = RunPlan(isolation=self._map.isolation, engine=self._map.engine_choice)
        (result,) = run_scenarios([loaded], plan, self._map.executor, Listener())
        self.shown[folder] = ShownExample(loaded, result)
        return result


def _failed_limit(claim: Claim, cell: ClaimCell, tracker: str) -> int | None:
    """Return the index in ``Claim.limits`` of the first requirement that a tracker fails in a cell, or None."""
    limit_numbers = [number for number, limit in enumerate(claim.limits) if limit.tracker == tracker]
    values = cell.trackers[tracker].values
    return next((number for number, value in zip(limit_numbers, values, strict=False) if value.state == "fails"), None)


def _run_values(cell: MapCell, item: ClaimedLimit) -> Array | None:
    """Return a requirement's metric in each run, ``(runs,)``, NaN in a run without a value; None if no run has one."""
    metric = next((metric for metric in cell.metrics if metric.path == item.metric), None)
    runs = cell.trackers[item.tracker].runs
    if metric is None or not metric.columns or not runs.sums:
        return None
    evaluation = evaluate(runs.sums, np.zeros(len(runs.run), dtype=np.intp), [metric])
    if metric.columns[0] in evaluation.run_columns:
        columns = [evaluation.run_columns[name] for name in metric.columns]
    elif "tracks" in metric.needs:
        columns = [*run_sums(evaluation.sums[TRACKS.name], metric.name)]
    else:
        record = run_sums_record(evaluation, runs.sums[ESTIMATES.name], ())
        columns = [np.asarray(record[name]) for name in metric.columns]
    intervals = [metric.of_runs(*(column[run : run + 1] for column in columns)) for run in range(len(runs.run))]
    return np.array([np.nan if interval is None else interval.value for interval in intervals])
