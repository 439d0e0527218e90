"""The tables of an envelope."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array
from trackbench.document import Cell, Column, Table, Tone
from trackbench.subjects.envelope.axes import MapAxis
from trackbench.subjects.envelope.claim import Claim, ClaimCell, Envelope, State
from trackbench.subjects.envelope.margins import AxisMargin, along, excess, holding, margins, undecided
from trackbench.subjects.envelope.sensitivity import Sensitivity, Swing, sensitivities

#: Cells of the table; the others are in the claim.
MOST_CELLS = 100
TONES: dict[State, Tone] = {"holds": "good", "fails": "bad", "undecided": "warn"}


def margins_table(claim: Claim) -> Table:
    """For each axis and tracker, where the requirement holds along the line through the scenario."""
    by_tracker = {tracker: margins(claim, tracker) for tracker in claim.trackers}
    lines = by_tracker[claim.trackers[0]]
    columns = [(Column("along", left=True), [Cell(line.axis.name, details=_at(line)) for line in lines])]
    for tracker, held in by_tracker.items():
        cells = [Cell(holding(margin), details=tuple(filter(None, [undecided(margin)]))) for margin in held]
        columns.append((Column(f"{tracker} holds", left=True), cells))
    through = all(line.through_base for line in lines)
    own = ", ".join(
        f"{axis.name} {'not stated' if base is None else axis.shown(base)}"
        for axis, base in zip(claim.axes, claim.base, strict=True)
    )
    caption = f"Along lines of cells {'through' if through else 'near'} the scenario itself ({own})"
    return Table.of_columns("margins", columns, caption)


def _at(margin: AxisMargin) -> tuple[str, ...]:
    """Where the line goes."""
    return (f"at {along(margin)}",) if margin.at else ()


def sensitivity_tables(made: Envelope) -> list[Table]:
    """For each requirement, how much each axis changes its value."""
    each = sensitivities(made)
    names = [f"sensitivity-{number}" if len(each) > 1 else "sensitivity" for number in range(1, len(each) + 1)]
    return [_sensitivity_table(item, name) for item, name in zip(each, names, strict=True)]


def _sensitivity_table(item: Sensitivity, name: str) -> Table:
    unit = "" if item.limit.unit == "1" else f", {item.limit.unit}"
    columns = [
        (Column("axis", left=True), [Cell(axis.name) for axis, _ in item.swings]),
        (
            Column(
                f"change{unit}",
                "From the start of the axis to its end, with the 95 % interval; of choices, least to largest.",
                details="from, to",
            ),
            [_swing(axis, swing) for axis, swing in item.swings],
        ),
    ]
    caption = item.limit.text
    if item.first:
        columns += [
            (Column("alone, %"), [Cell(f"{100 * share:.0f}") for share in item.first]),
            (Column("with others, %"), [Cell(f"{100 * share:.0f}") for share in item.total]),
        ]
        caption += (
            ". Shares of the variance over the whole map: Sobol indices of an interpolation that is off by "
            f"{100 * (item.error or 0.0):.0f} % of the spread at a cell left out"
        )
    elif item.error is not None:
        caption += (
            f". No shares of the variance: an interpolation is off by {100 * item.error:.0f} % of the spread at a cell "
            "left out"
        )
    return Table.of_columns(name, columns, caption)


def _swing(axis: MapAxis, swing: Swing | None) -> Cell:
    if swing is None:
        return Cell("n/a", reason="no line of cells with values runs along the axis")
    reach = "" if swing.reach is None else f" ± {swing.reach:.2g}"
    ends = f"{swing.low:.3g} at {axis.shown(swing.start)}, {swing.high:.3g} at {axis.shown(swing.stop)}"
    return Cell(f"{swing.change:+.3g}{reach}", details=(ends,))


def cells_table(claim: Claim) -> Table:
    """The cells with their states and values, those nearest to a limit first."""
    order = np.argsort(_nearness(claim), kind="stable")[:MOST_CELLS]
    cells = [claim.cells[number] for number in order]
    columns = [
        (Column(axis.name, left=True), [Cell(axis.shown(cell.point[number])) for cell in cells])
        for number, axis in enumerate(claim.axes)
    ]
    columns += [(Column(name, left=True), [_state(claim, cell, name) for cell in cells]) for name in claim.trackers]
    left = len(claim.cells) - len(cells)
    caption = f"The {len(cells)} cells nearest to a limit; {left} more are in claim.json" if left else ""
    return Table.of_columns("cells", columns, caption)


def _nearness(claim: Claim) -> Array:
    """``(cells,)`` how far the value nearest to its limit is from it, in units of its spread over the map."""
    least = np.full(len(claim.cells), np.inf)
    for tracker in claim.trackers:
        beyond = excess(claim.cells, tracker, claim.limits_of(tracker))
        spread = np.nanstd(beyond, axis=0)
        apart = np.abs(beyond) / np.where(spread > 0, spread, 1.0)
        least = np.fmin(least, np.fmin.reduce(apart, axis=1))
    return least


def _state(claim: Claim, cell: ClaimCell, tracker: str) -> Cell:
    """The state with what it rests on."""
    own = cell.trackers[tracker]
    details = [
        f"{limit.metric} {_number(value.value)} ({_number(value.low)} to {_number(value.high)})"
        for limit, value in zip(claim.limits_of(tracker), own.values, strict=False)
        if value.value is not None
    ]
    details += [own.cause] if own.cause else []
    return Cell(own.state, details=(*details, f"{own.scenes} x {own.runs} runs"), tone=TONES[own.state])


def _number(value: float | None) -> str:
    return "open" if value is None else f"{value:.3g}"
