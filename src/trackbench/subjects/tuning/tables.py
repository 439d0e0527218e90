"""The tables of the report of a tuning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from trackbench.document import Cell, Column, Table, Tone
from trackbench.report.numbers import decimals, interval_text, rounded, signed
from trackbench.report.tables import unit_after_heading
from trackbench.subjects.tuning.held_out import MeasureComparison
from trackbench.subjects.tuning.measures import WORDS
from trackbench.subjects.tuning.parameters import Parameter, option_text
from trackbench.subjects.tuning.tune import Tuning

#: Trials of the report; the JSON has all.
MOST = 100
_TONES: dict[str, Tone] = {"better": "good", "worse": "bad"}
#: What a verdict on the tuned values makes of their gain.
_GAINS: dict[str, tuple[str, Tone]] = {
    "better": ("an improvement", "good"),
    "worse": ("harm", "bad"),
    "equivalent": ("within the margin", ""),
    "undecided": ("may be noise", "warn"),
}
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


def gains_table(tunings: Sequence[Tuning]) -> Table:
    """Return the table of gains over the start, on one axis for all trackers; harm is below 0."""
    rows = [(item, row) for item in tunings for row in item.held_out.of(item.objective.measure)]
    relative = tunings[0].objective.measure != "log_likelihood"
    cells = [_gain(item, row, relative) for item, row in rows]
    ends = [end for cell in cells if cell.bar for end in cell.bar]
    gain = Column(
        f"gain, {'%' if relative else 'log-likelihood'}",
        "Above 0 the tuned values are better. With its 95 % interval.",
        axis=(min([0.0, *ends]), max([0.0, *ends])),
    )
    words = [_GAINS.get(row.verdict, (row.verdict, "warn")) for _, row in rows]
    columns = [
        (Column("tracker", left=True), [Cell(item.tracker, tracker=item.tracker) for item, _ in rows]),
        (gain, cells),
        (Column("which is", left=True), [Cell(word, tone=tone, chip=True) for word, tone in words]),
        (
            Column(f"start, tuned{unit_after_heading(rows[0][1].unit or '1') if rows else ''}"),
            [replace(_start_and_tuned(row), details=(), tone="") for _, row in rows],
        ),
        (Column("scenario", left=True), [Cell(row.scenario) for _, row in rows]),
    ]
    return Table.of_columns("gains", columns)


def _gain(item: Tuning, row: MeasureComparison, relative: bool) -> Cell:
    sign = 1.0 if item.objective.better == "larger" else -1.0
    scale = sign * (100.0 / abs(row.start.value) if relative and row.start.value else 1.0)
    value, low, high = (scale * end for end in (row.difference.value, *(row.difference.ci95 or (0.0, 0.0))))
    if row.difference.ci95 is None:
        low = high = value
    places = 1 if relative else 3
    ends = (min(low, high), max(low, high))
    return Cell(signed(value, places), _interval(ends if low != high else None, places), bar=(value, *ends))


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
    return Table.of_columns(f"{name}held-out", columns)


def trials_table(item: Tuning, name: str = "") -> Table:
    """Return the table of the trials, best first."""
    done = sorted((trial for trial in item.trials if not trial.failed), key=lambda trial: trial.loss)[:MOST]
    columns = [
        (
            Column(parameter.key),
            [Cell(option_text(trial.values[parameter.key]), strong=trial is item.best) for trial in done],
        )
        for parameter in item.parameters
    ]
    for measure in dict.fromkeys([*WORDS, item.objective.measure]):
        values = [trial.measures.get(measure) for trial in done]
        if any(value is not None for value in values):
            cells = [Cell(NONE if value is None else f"{value:.4g}") for value in values]
            columns.append((Column(WORDS[measure]), cells))
    return Table.of_columns(f"{name}trials", columns, "Best first, on what it was tuned on; the tuned values stand out")


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
