"""Whether what a claim states follows from itself: nothing is run again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from trackbench.subjects.envelope.axes import Point, overrides, start_points
from trackbench.subjects.envelope.cells import joint_state
from trackbench.subjects.envelope.claim import (
    CellValue,
    Claim,
    ClaimCell,
    ClaimedLimit,
    Envelope,
    State,
    TrackerState,
    hash_of,
    place_of_cell,
)
from trackbench.subjects.envelope.mapping import refined

#: What follows from the scenario in the claim.
HEADER = ("scenario", "claim", "confidence", "spent", "extents", "seed", "envelope", "limits", "base")
#: Of the mean of the runs' values and the value itself, relative to the largest of them.
ROUNDING = 1e-9


class Discrepancy(NamedTuple):
    """Something that a claim should not state."""

    where: str
    """The cell and the tracker; "the claim" of what concerns all of it."""
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}"


def contradictions(made: Envelope, expected: Claim) -> Iterator[Discrepancy]:
    """What in a claim does not follow from the rest of it.

    Args:
        made: the claim and the values of its runs.
        expected: the claim on no cell that the scenario in it gives.
    """
    claim = made.claim
    for name in HEADER:
        if getattr(claim, name) != getattr(expected, name):
            yield Discrepancy("the claim", f"{name} is not that of the scenario in it")
    if len(made.parts) and hash_of(made.parts) != claim.parts_hash:
        yield Discrepancy("the claim", "the values of the runs have another hash")
    yield from _design(claim)
    for number, cell in enumerate(claim.cells):
        where = place_of_cell(claim.axes, cell.at)
        if cell.changes != overrides(claim.axes, cell.at):
            yield Discrepancy(where, "its changes are not those of its values of the axes")
        for name, tracker in cell.trackers.items():
            for what in _of_tracker(claim, tracker, cell):
                yield Discrepancy(f"{where}, {name}", what)
        for place, limit in enumerate(claim.limits):
            for what in _of_value(made, number, place, cell.trackers[limit.tracker]):
                yield Discrepancy(f"{where}, {limit.tracker} {limit.metric}", what)


def _design(claim: Claim) -> Iterator[Discrepancy]:
    """The cells follow from the axes, and those near borders from the states of the others."""
    config, axes, cells = claim.config, claim.axes, claim.by_point()
    if len(cells) < len(claim.cells):
        yield Discrepancy("the claim", "a cell stands there twice")
    seen: dict[Point, dict[str, State]] = {}
    points, added = start_points(axes, config, claim.base), False
    while points:
        for point in points:
            cell = cells.get(point)
            if cell is None:
                yield Discrepancy(place_of_cell(axes, point), "the map has to have this cell, and it is not there")
                return
            if cell.added != added:
                yield Discrepancy(place_of_cell(axes, point), "added is wrong")
            seen[point] = {name: tracker.state for name, tracker in cell.trackers.items()}
        points = refined(axes, seen, config.cells - len(seen), config.resolution, config.design)
        added = True
    for cell in claim.cells:
        if cell.at not in seen:
            yield Discrepancy(place_of_cell(axes, cell.at), "the map cannot have this cell")


def _of_tracker(claim: Claim, tracker: TrackerState, cell: ClaimCell) -> Iterator[str]:
    """Its state follows from those of its requirements, and its runs from the looks."""
    states = [value.state for value in tracker.values]
    expected = joint_state(states)
    if tracker.cause and tracker.state == "holds":
        yield f"holds, and yet {tracker.cause}"
    # What is missing may make it worse than its values are.
    elif tracker.state != expected and not (tracker.cause and joint_state([expected, tracker.state]) == tracker.state):
        yield f"is said to be {tracker.state}, and its values say {expected}"
    if tracker.cause and not tracker.looks:
        return
    if not 0 < tracker.looks <= len(claim.extents):
        yield f"{tracker.looks} looks, of {len(claim.extents)} that there are"
        return
    if (tracker.scenes, tracker.runs) != claim.extents[tracker.looks - 1]:
        yield f"{tracker.scenes} scenes of {tracker.runs} runs are not those of look {tracker.looks}"
    if tracker.state == "undecided" and tracker.looks < len(claim.extents):
        yield f"is undecided after look {tracker.looks}, and was not looked at again"
    if len(cell.measurements) < tracker.looks:
        yield f"{tracker.looks} looks, and measurements of {len(cell.measurements)}"


def _of_value(made: Envelope, number: int, place: int, tracker: TrackerState) -> Iterator[str]:
    """The state of a requirement follows from its bounds, and its value from the runs."""
    claim, limit = made.claim, made.claim.limits[place]
    own = claim.limits_of(limit.tracker)
    if len(tracker.values) != len(own):
        return
    value, parts = tracker.values[own.index(limit)], made.values(number, place)
    if value.state != (expected := state_of(value, limit)):
        yield f"is said to be {value.state}, and its bounds say {expected}"
    if value.value is None or not len(made.parts):
        return
    wanted = tracker.scenes if claim.claim == "traffic like these" else tracker.runs
    if len(parts) != wanted:
        yield f"there are the values of {len(parts)} runs, not of {wanted}"
    elif abs(float(np.mean(parts)) - value.value) > ROUNDING * float(np.abs(parts).max()):
        yield f"the value is {value.value:.10g}, and the mean of its runs {float(np.mean(parts)):.10g}"


def state_of(value: CellValue, limit: ClaimedLimit) -> State:
    """What the bounds of a value say of its limit."""
    under = value.high is not None and value.high < limit.limit
    over = value.low is not None and value.low > limit.limit
    if under or over:
        return "holds" if under == (limit.direction == "below") else "fails"
    return "undecided"
