"""The map of an envelope in characters, and its border in a sentence, for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from trackbench.document import Block, Code, Paragraph
from trackbench.report.numbers import joined_names
from trackbench.subjects.envelope.claim import Claim, State
from trackbench.subjects.envelope.margins import distance_from_base, holding, margins, slices

MARKS: dict[State, str] = {"holds": "#", "fails": "x", "undecided": "?"}
#: Largest number of columns and of rows; with more, cells added near the border are left out.
_MOST = 20


def map_blocks(claim: Claim, tracker: str) -> Iterator[Block]:
    """Yield a sentence on the border of a tracker, and its map over the first two axes of numbers."""
    lines = margins(claim, tracker)
    nearest = [
        min((line for line in lines if line.axis.name == name), key=lambda line: distance_from_base(claim, line.at))
        for name in dict.fromkeys(line.axis.name for line in lines)
    ]
    if nearest:
        along = joined_names([f"along {line.axis.name} {holding(line)}" for line in nearest])
        yield Paragraph(f"Near the scenario {tracker} holds {along}.")
    if text := text_map(claim, tracker):
        yield Code(text)


def text_map(claim: Claim, tracker: str) -> str:
    """Return a map with a character for each cell, on the slice nearest to the scenario.

    "#" holds, "x" fails, "?" is undecided; the cell nearest to the scenario is in brackets. Empty with
    fewer than two axes of numbers.
    """
    pair = next(combinations([i for i, axis in enumerate(claim.axes) if axis.ordered], 2), None)
    if pair is None:
        return ""
    part = min(slices(claim, *pair), key=lambda part: distance_from_base(claim, part.at))
    points = {(float(cell.point[pair[0]]), float(cell.point[pair[1]])): cell for cell in part.cells}
    if any(len({point[side] for point in points}) > _MOST for side in (0, 1)):
        points = {point: cell for point, cell in points.items() if not cell.added}
    across, up = (sorted({point[side] for point in points}) for side in (0, 1))
    axes = (part.across, part.up)
    is_on_map = all(axis.reaches(claim.own_values[axis.name]) for axis in axes)
    marked = min(points, key=lambda at: distance_from_base(claim, [*zip(axes, at, strict=True)])) if is_on_map else None
    labels = {y: f"{y:.3g}" for y in up}
    width = max(map(len, labels.values()))

    def mark(x: float, y: float) -> str:
        cell = points.get((x, y))
        text = MARKS[cell.trackers[tracker].state] if cell else " "
        return f"[{text}]" if (x, y) == marked else f" {text} "

    rows = [f"{labels[y]:>{width}} {''.join(mark(x, y) for x in across)}" for y in reversed(up)]
    ends = f"{across[0]:.3g}".ljust(max(3 * len(across) - len(f"{across[-1]:.3g}"), 4)) + f"{across[-1]:.3g}"
    key = "# holds  x fails  ? not shown" + "  [ ] the scenario" * (marked is not None)
    head = f"{tracker}: {part.up.name}, {part.up.unit or '1'}, over {part.across.name}, {part.across.unit or '1'}"
    return "\n".join([head, *rows, f"{'':>{width}} {ends}", key])
