"""The tables of the report of a tuning."""

from __future__ import annotations

from trackbench.document import Cell, Column, Table, Tone
from trackbench.report.numbers import decimals, interval_text, joined_names, rounded, signed
from trackbench.report.pairs import difference_word
from trackbench.subjects.tuning.held_out import MeasureComparison
from trackbench.subjects.tuning.measures import WORDS
from trackbench.subjects.tuning.parameters import Parameter, option_text
from trackbench.subjects.tuning.tune import Tuning

_TONES: dict[str, Tone] = {"better": "good", "worse": "bad"}
NONE = "-"


def values_table(item: Tuning, name: str = "") -> Table:
    """Return the table of options with their start value, tuned value and range."""
    keys = [parameter.key for parameter in item.parameters]
    at_edge = {parameter.key for parameter, _ in item.edges}
    best = [
        Cell(option_text(item.best.values[key]), strong=True, tone="warn" if key in at_edge else "") for key in keys
    ]
    columns = [
        (Column("option", left=True), [Cell(key) for key in keys]),
        (Column("start"), [Cell(NONE if item.start[key] is None else option_text(item.start[key])) for key in keys]),
        (Column("tuned"), best),
        (Column("tried"), [Cell(_range_text(parameter)) for parameter in item.parameters]),
    ]
    return Table.of_columns(f"{name}values", columns)


def held_out_table(item: Tuning, name: str = "") -> Table:
    """Return the table that compares start and tuned values on held-out measurements, by measure and scenario."""
    measures = dict.fromkeys([item.objective.measure, *WORDS])
    rows = [comparison for measure in measures for comparison in item.held_out.of(measure)]
    columns = [
        (Column("measure", left=True), [Cell(_measure_with_unit(row)) for row in rows]),
        *([(Column("scenario", left=True), [Cell(row.scenario) for row in rows])] if len(item.scenarios) > 1 else []),
        (Column("start"), [Cell(rounded(row.start.value, _decimals(row))) for row in rows]),
        (Column("tuned"), [Cell(rounded(row.tuned.value, _decimals(row))) for row in rows]),
        (Column("difference", "Paired difference with its 95 % interval."), [_difference(row) for row in rows]),
        (
            Column("verdict", left=True),
            [Cell(difference_word(row.verdict), tone=_TONES.get(row.verdict, "")) for row in rows],
        ),
    ]
    others = joined_names(list(dict.fromkeys(filter(None, item.apart))))
    return Table.of_columns(f"{name}held-out", columns, f"On {others or 'the measurements that it was tuned on'}")


def _range_text(parameter: Parameter) -> str:
    if parameter.scale == "choice":
        return ", ".join(option_text(choice) for choice in parameter.choices)
    return f"{option_text(parameter.low)} to {option_text(parameter.high)}"


def _measure_with_unit(row: MeasureComparison) -> str:
    return f"{WORDS[row.measure]}{f', {row.unit}' if row.unit else ''}"


def _decimals(row: MeasureComparison) -> int:
    return decimals([row.start.value, row.tuned.value], 4)


def _difference(row: MeasureComparison) -> Cell:
    ends = row.difference.ci95
    return Cell(signed(row.difference.value, _decimals(row)), (interval_text(ends, _decimals(row)),) if ends else ())
