"""Shows each counter-example by its median failing run, with its cause."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from trackbench.api.plan import Listener, RunPlan
from trackbench.api.prepare import prepare
from trackbench.api.run import run_prepared
from trackbench.base.types import Array
from trackbench.results import Result
from trackbench.runner.tables import run_values
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


class Facing(NamedTuple):
    """A cell that fails, and the face of the map that it lies towards."""

    tracker: str
    axis: str
    side: str
    cell: int
    """Its number in the claim."""
    distance: float


def base_of(claim: Claim, tracker: str) -> BasePoint:
    """Return the scenario's own point; the nearest cell that holds where the cell nearest to the scenario does not."""
    axes, own = claim.axes, claim.base_point
    state = _nearest(axes, own, claim.cells).trackers[tracker].state
    holding = [cell for cell in claim.cells if cell.trackers[tracker].state == "holds"]
    if state == "holds" or not holding:
        return BasePoint(tracker=tracker, point=list(own), note="")
    what = "fails" if state == "fails" else "is undecided"
    note = f"the scenario {what}: distances are from the nearest cell that holds"
    return BasePoint(tracker=tracker, point=list(_nearest(axes, own, holding).at), note=note)


def nearest_failing(claim: Claim, base: BasePoint, most: int | None = None) -> list[Facing]:
    """Towards each face the nearest cell that fails, the nearest first.

    A cell lies towards the face of the axis along which it is furthest from the base. One that is further along this
    axis than another that fails, and no nearer along any other, shows nothing new: it does not fail for this axis.

    Args:
        claim: of the map.
        base: from where distances are counted, of a tracker.
        most: how many; twice the number of axes unless given.
    """
    failing = [number for number, cell in enumerate(claim.cells) if cell.trackers[base.tracker].state == "fails"]
    away = np.array(
        [
            [axis.distance(a, b) for axis, a, b in zip(claim.axes, base.at, claim.cells[number].at, strict=True)]
            for number in failing
        ]
    ).reshape(len(failing), len(claim.axes))
    facings: dict[tuple[str, str], Facing] = {}
    for number, ways in zip(failing, away, strict=True):
        place = int(np.argmax(ways))
        if ways[place] == 0 or np.any((away <= ways).all(axis=1) & (away[:, place] < ways[place])):
            continue
        axis, cell = claim.axes[place], claim.cells[number]
        side, length = _side(base.at[place], cell.at[place]), point_distance(claim.axes, base.at, cell.at)
        if (axis.name, side) not in facings or length < facings[axis.name, side].distance:
            facings[axis.name, side] = Facing(base.tracker, axis.name, side, number, length)
    nearest = sorted(facings.values(), key=lambda facing: facing.distance)
    return nearest[: 2 * len(claim.axes) if most is None else most]


def _side(start: Value, value: Value) -> str:
    if isinstance(value, str) or isinstance(start, str):
        return str(value)
    return "high" if value > start else "low"


def _nearest(axes: tuple[MapAxis, ...], point: Point, cells: list[ClaimCell]) -> ClaimCell:
    return min(cells, key=lambda cell: point_distance(axes, point, cell.at))


#: What the name of a folder does not have.
UNFIT = re.compile(r"[^A-Za-z0-9_.-]+")


class CounterMaker:
    """Makes the counter-examples of a map.

    Args:
        made: the map; they are made as its cells were.
        claim: what is claimed of it.
    """

    def __init__(self, made: EnvelopeMap, claim: Claim) -> None:
        self._made, self._claim, self._task = made, claim, made.task
        self._cells = [*made.cells.values()]
        self.shown: dict[str, ShownExample] = {}
        """By the name of the folder of each counter-example."""

    def make(self, most: int | None, listener: Listener) -> CounterExamples:
        """All of them.

        Args:
            most: of a tracker; unless given, twice the number of axes.
            listener: is told of the work.
        """
        bases = [base_of(self._claim, tracker) for tracker in self._claim.trackers]
        facings = [facing for base in bases for facing in nearest_failing(self._claim, base, most)]
        findings: dict[str, str] = {}
        examples = []
        with listener.progress(f"counter-examples of {self._claim.scenario}", "examples") as advance:
            for number, facing in enumerate(facings, 1):
                advance(number - 1, len(facings))
                example = self._example(number, facing)
                if facing.tracker not in findings:
                    loaded = self.shown[example.folder].loaded
                    findings[facing.tracker] = finding_on(loaded, facing.tracker, self._made.executor)
                examples.append(example.model_copy(update={"finding": findings[facing.tracker]}))
        return CounterExamples(bases=bases, examples=examples)

    def _example(self, number: int, facing: Facing) -> CounterExample:
        cell, claimed = self._cells[facing.cell], self._claim.cells[facing.cell]
        limit = _failed_limit(self._claim, claimed, facing.tracker)
        requirement = None if limit is None else self._task.requirements[limit]
        shown = self._shown(cell, facing.tracker, requirement)
        folder = UNFIT.sub("-", f"{number}-{facing.tracker}-{facing.axis}-{facing.side}")
        result = self._run(folder, cell, facing.tracker, requirement, shown)
        metric = "" if requirement is None else requirement.metric
        return CounterExample(
            folder=folder,
            **facing._asdict(),
            limit=limit,
            shown=shown,
            event=event_of(result, facing.tracker, metric),
            finding="",
        )

    def _shown(self, cell: MapCell, tracker: str, requirement: ClaimedLimit | None) -> ShownRun:
        own = cell.trackers[tracker]
        values = None if requirement is None else _values(cell, requirement)
        if requirement is None or values is None:
            return ShownRun(scene=0, run=0, value=None, beyond=None, runs=len(own.runs.run))
        order = np.argsort(values)
        beyond = [run for run in order if np.isfinite(values[run]) and requirement.excess(values[run]) >= 0]
        # Where the mean is beyond the limit and no run is, that nearest to it.
        nearest = order[np.nanargmax([requirement.excess(values[run]) for run in order])]
        middle = beyond[(len(beyond) - 1) // 2] if beyond else nearest
        return ShownRun(
            scene=int(own.runs.scene[middle]),
            run=int(own.runs.run[middle]),
            value=float(values[middle]),
            beyond=len(beyond),
            runs=len(values),
        )

    def _run(
        self, folder: str, cell: MapCell, tracker: str, requirement: ClaimedLimit | None, shown: ShownRun
    ) -> Result:
        """The cell's scenario with as many runs as it had, of which that to be shown is recorded."""
        extent = cell.trackers[tracker].extent
        changes = [f"recording.scene={shown.scene}", f"recording.run={shown.run}"]
        changes.append(f"monte_carlo.runs={max(1, extent.runs)}")
        if self._task.config.claim == "traffic like these":
            changes.append(f"truth.seeds={max(1, extent.scenes)}")
        loaded = changed_scenario(cell.loaded, changes, [tracker])
        plan, executor = RunPlan(isolation=self._made.isolation, engine=self._made.engine_choice), self._made.executor
        (result,) = run_prepared(prepare([loaded], plan, executor, Listener()), plan, executor, Listener())
        self.shown[folder] = ShownExample(loaded, result)
        return result


def _failed_limit(claim: Claim, cell: ClaimCell, tracker: str) -> int | None:
    """The number of the requirement that a tracker does not meet in a cell."""
    own = [number for number, limit in enumerate(claim.limits) if limit.tracker == tracker]
    values = cell.trackers[tracker].values
    return next((number for number, value in zip(own, values, strict=False) if value.state == "fails"), None)


def _values(cell: MapCell, item: ClaimedLimit) -> Array | None:
    """Return the required value of each run ``(runs,)``; None where runs do not tell it."""
    metric, own = next((each for each in cell.metrics if each.path == item.metric), None), cell.trackers[item.tracker]
    return None if metric is None or not own.runs.sums else run_values(metric, own.runs.sums, len(own.runs.run))
