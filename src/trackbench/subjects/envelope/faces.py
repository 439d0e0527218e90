"""The cells that fail nearest to the scenario, one towards each face of the map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.subjects.envelope.axes import MapAxis, Point, Value, distance
from trackbench.subjects.envelope.claim import Claim, ClaimCell
from trackbench.subjects.envelope.counter_models import BasePoint


class Facing(NamedTuple):
    """A cell that fails, and the face of the map that it lies towards."""

    tracker: str
    axis: str
    side: str
    cell: int
    """Its number in the claim."""
    distance: float


def base_of(claim: Claim, tracker: str) -> BasePoint:
    """The scenario's own point; the nearest cell that holds where the scenario fails, or is not shown to hold.

    Where the scenario is no cell of the map, the nearest cell says whether it holds.
    """
    axes, notes = claim.axes, []
    own = tuple(
        axis.values[len(axis.values) // 2] if value is None else value
        for axis, value in zip(axes, claim.base, strict=True)
    )
    if unknown := [axis.name for axis, value in zip(axes, claim.base, strict=True) if value is None]:
        notes.append(f"the scenario has no value of {' and '.join(unknown)}, of which the middle one is taken")
    nearest = _nearest(axes, own, claim.cells)
    state = nearest.trackers[tracker].state
    holding = [cell for cell in claim.cells if cell.trackers[tracker].state == "holds"]
    if state != "holds" and holding:
        what = "fails" if state == "fails" else "is undecided"
        which = "the scenario itself" if nearest.at == tuple(claim.base) else "the cell nearest to the scenario"
        notes.append(f"{which} {what}: distances are from the nearest cell that holds")
        own = _nearest(axes, own, holding).at
    elif state != "holds":
        notes.append("no cell holds: distances are from the scenario itself")
    return BasePoint(tracker=tracker, point=list(own), note="; ".join(notes))


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
        side, length = _side(base.at[place], cell.at[place]), distance(claim.axes, base.at, cell.at)
        if (axis.name, side) not in facings or length < facings[axis.name, side].distance:
            facings[axis.name, side] = Facing(base.tracker, axis.name, side, number, length)
    nearest = sorted(facings.values(), key=lambda facing: facing.distance)
    return nearest[: 2 * len(claim.axes) if most is None else most]


def _side(start: Value, value: Value) -> str:
    if isinstance(value, str) or isinstance(start, str):
        return str(value)
    return "high" if value > start else "low"


def _nearest(axes: tuple[MapAxis, ...], point: Point, cells: list[ClaimCell]) -> ClaimCell:
    return min(cells, key=lambda cell: distance(axes, point, cell.at))
