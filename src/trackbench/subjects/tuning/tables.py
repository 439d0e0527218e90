"""The tables of the report of a tuning."""

from __future__ import annotations

from trackbench.document import Cell, Column, Table, Tone
from trackbench.report.numbers import decimals, interval_text, rounded, signed
from trackbench.subjects.tuning.held_out import MeasureComparison
from trackbench.subjects.tuning.measures import WORDS
from trackbench.subjects.tuning.parameters import Parameter, option_text
from trackbench.subjects.tuning.tune import Tuning

_TONES: dict[str, Tone] = {"better": "good", "worse": "bad"}
NONE = "-"


def values_table(item: Tuning, name: str = "") -> Table:
    """Return the table of options: their start, tuned value and range."""
    keys = [parameter.key for parameter in item.parameters]
    at_edge = {parameter.key for parameter, _ in item.edges}
    best = [
        Cell(option_text(item.best.values[key]), strong=True, tone="warn" if key in at_edge else "") for key in keys
    ]
    columns = [
        (Column("option", left=True), [Cell(key) for key in keys]),
        (Column("start"), [Cell(NONE if item.start is None else option_text(item.start[key])) for key in keys]),
        (Column("tuned"), best),
        (Column("tried"), [Cell(_tried(parameter)) for parameter in item.parameters]),
    ]
    return Table.of_columns(f"{name}values", columns)


def held_out_table(item: Tuning, name: str = "") -> Table:
    """Return the table of start against tuned values on what they were not tuned on, by scenario."""
    main = item.objective.measure
    others = [measure for measure in WORDS if measure != main and item.held_out.of(measure)]
    compared = item.held_out.of(main)
    places = decimals([end.value for comparison in compared for end in (comparison.start, comparison.tuned)], 4)
    unit = compared[0].unit if compared else ""
    start = Column(f"{WORDS[main]}{f', {unit}' if unit else ''}: start")
    difference = Column("difference", "With its 95 % interval, from the same runs.", details="95 % interval")
    columns = [
        (Column("scenario", left=True), [Cell(row.scenario) for row in compared]),
        *(
            (column, [Cell(text(side.value, places), _interval(side.ci95, places)) for side in sides])
            for column, text, sides in (
                (start, rounded, [row.start for row in compared]),
                (Column("tuned"), rounded, [row.tuned for row in compared]),
                (difference, signed, [row.difference for row in compared]),
            )
        ),
        (Column("verdict", left=True), [Cell(row.verdict, tone=_TONES.get(row.verdict, "")) for row in compared]),
    ]
    for measure in others:
        by_scenario = {comparison.scenario: comparison for comparison in item.held_out.of(measure)}
        cells = [_start_and_tuned(by_scenario.get(row.scenario)) for row in compared]
        columns.append((Column(f"{WORDS[measure]}: start, tuned", details="verdict"), cells))
    caption = f"On measurements that it was {'not ' if any(item.apart) else ''}tuned on"
    return Table.of_columns(f"{name}held-out", columns, caption)


def _tried(parameter: Parameter) -> str:
    if parameter.scale == "choice":
        return ", ".join(option_text(choice) for choice in parameter.choices)
    return f"{option_text(parameter.low)} to {option_text(parameter.high)}"


def _interval(ends: tuple[float, float] | None, places: int) -> tuple[str, ...]:
    return (interval_text(ends, places),) if ends else ()


def _start_and_tuned(comparison: MeasureComparison | None) -> Cell:
    if comparison is None:
        return Cell(NONE)
    values = [comparison.start.value, comparison.tuned.value]
    places, tone = decimals(values, 4), _TONES.get(comparison.verdict, "")
    return Cell(", ".join(rounded(value, places) for value in values), (comparison.verdict,), tone)
