"""The tables of the report of a tuning."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from trackbench.document import Cell, Column, Table, Tone
from trackbench.report.numbers import decimals, interval_text, rounded, signed
from trackbench.report.tables import unit_after_heading
from trackbench.subjects.tuning.held_out import MeasureComparison
from trackbench.subjects.tuning.measures import WORDS
from trackbench.subjects.tuning.objectives import Parts, has_nees, mean_nees
from trackbench.subjects.tuning.parameters import Parameter, option_text
from trackbench.subjects.tuning.search import NEGLIGIBLE, Response, ResponsePoint
from trackbench.subjects.tuning.study import TuningTrial
from trackbench.subjects.tuning.tune import Tuning

#: Trials of the report; all are in the study and in the JSON.
MOST = 200
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
    """What was tuned."""
    responses = {response.parameter.key: response for response in item.responses}
    keys = [parameter.key for parameter in item.parameters]
    best = [
        Cell(option_text(item.best.values[parameter.key]), strong=True, tone="warn" if at_edge else "")
        for parameter in item.parameters
        for at_edge in [parameter.edge(item.best.values[parameter.key]) is not None]
    ]
    optimum = Column(
        "optimum, 95 %",
        "Where it lies as far as these runs tell, the other options as they are; of a choice, the values that are "
        "not shown to be worse.",
    )
    columns = [
        (Column("option", left=True), [Cell(key) for key in keys]),
        (Column("start"), [Cell(NONE if item.start is None else option_text(item.start[key])) for key in keys]),
        (Column("tuned"), best),
        (Column("tried"), [Cell(_tried(parameter)) for parameter in item.parameters]),
        (optimum, [Cell(_optimum(responses[key], item) if key in responses else NONE) for key in keys]),
    ]
    return Table.of_columns(f"{name}values", columns)


def gains_table(tunings: Sequence[Tuning]) -> Table:
    """How much better the tuned values are than the start, on one axis for all trackers; harm is below 0."""
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
    """Start against tuned, by scenario."""
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
        by_scenario = {comparison.scenario: comparison for comparison in reversed(item.held_out.of(measure))}
        cells = [_start_and_tuned(by_scenario.get(row.scenario)) for row in compared]
        columns.append((Column(f"{WORDS[measure]}: start, tuned", details="verdict"), cells))
    return Table.of_columns(f"{name}held-out", columns)


def response_table(item: Tuning, name: str = "") -> Table:
    """Which option matters, and how sharply; without choices, of which none is half of another."""
    numbers = [response for response in item.responses if response.parameter.scale != "choice"]
    relative = item.objective.measure != "log_likelihood"
    unit = f"{WORDS[item.objective.measure]}, %" if relative else "log-likelihood"
    others = any(response.parameter.scale != "log" for response in numbers)
    low, high = ("half, or the next below", "twice, or the next above") if others else ("half of it", "twice")
    changes = [
        [_change(point, item.best.parts, response.parameter) for point in _nearest(response, item)]
        for response in numbers
    ]
    low_column = Column(f"{low}: {unit}", "What changes where this option alone has this value.", details="mean NEES")
    columns = [
        (Column("option", left=True), [Cell(response.parameter.key) for response in numbers]),
        (Column("tuned"), [Cell(option_text(item.best.values[response.parameter.key])) for response in numbers]),
        (low_column, [below for below, _ in changes]),
        (Column(f"{high}: {unit}", details="mean NEES"), [above for _, above in changes]),
    ]
    if relative and not has_nees(item.best.parts):
        cells = [
            Cell(_range_text(response.within(NEGLIGIBLE)) if response.parameter.continuous else NONE)
            for response in numbers
        ]
        columns.append((Column("within 1 % of the optimum"), cells))
    return Table.of_columns(f"{name}response", columns, "The option that matters most comes first")


def front_table(item: Tuning, name: str = "") -> Table:
    """The trials that none beats in both."""
    errors = [
        Cell(f"{trial.measures.get('position_rmse', math.nan):.4g}", strong=trial.values == item.best.values)
        for trial in item.front
    ]
    columns = [
        *_options(item, item.front, strong=False),
        (Column("position RMSE, m"), errors),
        (Column("mean NEES"), [Cell(f"{trial.measures.get('nees', math.nan):.3g}") for trial in item.front]),
    ]
    return Table.of_columns(f"{name}front", columns, "On what it was tuned on; the written one stands out")


def trials_table(item: Tuning, name: str = "") -> Table:
    """The trials, best first."""
    measures = dict.fromkeys([*WORDS, item.objective.measure])
    last = all(trial.values != item.best.values for trial in item.trials)
    tried = [*item.trials, *([item.best] if last else [])]
    done = sorted((trial for trial in tried if trial.losses), key=lambda trial: item.objective.rank(trial.parts))[:MOST]
    columns = _options(item, done, strong=True)
    for measure in measures:
        if any(measure in trial.measures for trial in item.trials):
            values = [trial.measures.get(measure) for trial in done]
            columns.append(
                (Column(WORDS[measure]), [Cell(NONE if value is None else f"{value:.4g}") for value in values])
            )
    from_last = ", and come from the last step, each option by itself" if last else ""
    caption = f"Best first, on what it was tuned on; the tuned values stand out{from_last}"
    return Table.of_columns(f"{name}trials", columns, caption)


def _options(item: Tuning, trials: Sequence[TuningTrial], strong: bool) -> list[tuple[Column, list[Cell]]]:
    """A column for each option; ``strong``: whether the tuned values stand out."""
    return [
        (
            Column(parameter.key),
            [
                Cell(option_text(trial.values[parameter.key]), strong=strong and trial.values == item.best.values)
                for trial in trials
            ],
        )
        for parameter in item.parameters
    ]


def _tried(parameter: Parameter) -> str:
    if parameter.scale == "choice":
        return ", ".join(option_text(choice) for choice in parameter.choices)
    return f"{option_text(parameter.low)} to {option_text(parameter.high)}"


def _optimum(response: Response, item: Tuning) -> str:
    """How far the runs tell where the optimum is; a price on inconsistency bends the objective too sharply for that."""
    if has_nees(item.best.parts):
        return NONE
    if not response.parameter.continuous:
        return ", ".join(option_text(value) for value in response.as_good)
    return _range_text(response.optimum95) if response.has_reach else NONE


def _range_text(ends: tuple[float | None, float | None]) -> str:
    low, high = ends
    if low is None:
        return "all that was tried" if high is None else f"up to {option_text(high)}"
    return f"from {option_text(low)}" if high is None else f"{option_text(low)} to {option_text(high)}"


def _nearest(response: Response, item: Tuning) -> tuple[ResponsePoint | None, ResponsePoint | None]:
    """Half and twice the value; of another scale the values next to it."""
    points = response.points
    if response.parameter.scale == "log":
        best = item.best.values[response.parameter.key]
        half, twice = (
            next((point for point in points if abs(point.value / best - factor) < 0.01 * factor), None)
            for factor in (0.5, 2.0)
        )
        return half, twice
    place = next(i for i, point in enumerate(points) if point.best)
    low = points[place - 1] if place > 0 else None
    return low, points[place + 1] if place + 1 < len(points) else None


def _change(point: ResponsePoint | None, best: Parts, parameter: Parameter) -> Cell:
    """How far the main quantity of the objective is from that of the best values."""
    if point is None or not point.parts:
        return Cell(NONE)
    details = () if parameter.scale == "log" else (f"at {option_text(point.value)}",)
    if has_nees(best):
        details = (*details, f"mean NEES {mean_nees(point.parts):.2g}")
    if "likelihood" in best:
        return Cell(signed(best["likelihood"] - point.parts["likelihood"], 4), details)
    return Cell(signed(100 * math.expm1(point.parts["error"] - best["error"]), 1), details)


def _interval(ends: tuple[float, float] | None, places: int) -> tuple[str, ...]:
    return (interval_text(ends, places),) if ends else ()


def _start_and_tuned(comparison: MeasureComparison | None) -> Cell:
    if comparison is None:
        return Cell(NONE)
    values = [comparison.start.value, comparison.tuned.value]
    places, tone = decimals(values, 4), _TONES.get(comparison.verdict, "")
    return Cell(", ".join(rounded(value, places) for value in values), (comparison.verdict,), tone)
