"""The moments of the recorded run in which each tracker was worst, and how to look at them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from trackbench.document import Block, Cell, Code, Column, Paragraph, Section, Table
from trackbench.metrics.moments import EstimateMoment, worst
from trackbench.metrics.recorded_run import recorded_run
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed
from trackbench.report.run.cells import TRACKER
from trackbench.results import Result


def worst_moments(result: Result) -> dict[str, EstimateMoment]:
    """By tracker, best first, the scored moment of its largest position error in the recorded run."""
    names = [tracker.name for tracker in result.scored]
    if not names:
        return {}
    recorded = recorded_run(result)
    found = {name: worst(recorded, [name], 1) for name in names if name in recorded.tracks}
    return {name: moments[0] for name, moments in found.items() if moments}


def moments_section(moments: Mapping[str, EstimateMoment], run: int, ringed: Sequence[str]) -> Iterator[Section]:
    """The worst moments, and the commands that show them in the recording.

    Args:
        moments: by tracker.
        run: number of the recorded run.
        ringed: the trackers whose moments the map rings.
    """
    if not moments:
        return
    text = (
        f"The largest position error of each tracker in run {run}, of those that count. In the folder of this run, "
        "trackbench inspect . --worst 3 lists more, and these commands open the recording at the rings of the map:"
    )
    shown = [name for name in ringed if name in moments]
    commands = "\n".join(f"trackbench view . --worst --tracker {name}" for name in shown)
    blocks: tuple[Block, ...] = (_table(moments), Paragraph(text), Code(commands, "sh"))
    yield Section("Worst moments", blocks)


def say(moment: EstimateMoment) -> str:
    """Such as "3.18 m, v5 at 7.40 s"."""
    return f"{fixed(moment.position_error_m, 2)} m, {moment.object} at {fixed(moment.time_s, 2)} s"


def _table(moments: Mapping[str, EstimateMoment]) -> Table:
    every = list(moments.values())
    numbers = {
        "position error, m": [moment.position_error_m for moment in every],
        "velocity error, m/s": [moment.velocity_error_mps for moment in every],
        "NEES, 4 expected": [moment.nees for moment in every],
    }
    columns = [
        (TRACKER, [Cell(name, tracker=name) for name in moments]),
        (Column("time, s"), [Cell(fixed(moment.time_s, 2)) for moment in every]),
        (Column("vehicle", left=True), [Cell(moment.object) for moment in every]),
        *((Column(heading), _cells(values)) for heading, values in numbers.items()),
    ]
    return Table.of_columns("worst-moments", columns)


def _cells(values: Sequence[float | None]) -> list[Cell]:
    places = decimals(values)
    return [
        Cell(NOT_AVAILABLE, reason="the tracker does not give what this needs") if value is None
        else Cell(fixed(value, places))
        for value in values
    ]  # fmt: skip
