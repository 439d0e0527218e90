"""The tables of the report of a tuning."""

from __future__ import annotations

import math
from typing import Any

from trackbench.document import Cell, Column, Table
from trackbench.document.model import Tone
from trackbench.metrics.intervals import Interval
from trackbench.report.numbers import decimals, fixed, interval, signed
from trackbench.subjects.tuning.held_out import MeasureComparison
from trackbench.subjects.tuning.measures import WORDS
from trackbench.subjects.tuning.objectives import NEES, Parts, mean_nees
from trackbench.subjects.tuning.parameters import Parameter, shown
from trackbench.subjects.tuning.response import NEGLIGIBLE, Response, ResponsePoint
from trackbench.subjects.tuning.tune import Tuning

#: Trials of the report; all are in the study and in the JSON.
MOST = 200
_TONES: dict[str, Tone] = {"better": "good", "worse": "bad"}
NONE = "-"


def values(item: Tuning, name: str = "") -> Table:
    """What was tuned."""
    responses = {response.parameter.key: response for response in item.responses}
    rows = []
    for parameter in item.parameters:
        start = NONE if item.start is None else shown(item.start[parameter.key])
        response = responses.get(parameter.key)
        cells = [parameter.key, start, shown(item.best.values[parameter.key]), _tried(parameter)]
        edge = parameter.edge(item.best.values[parameter.key]) is not None
        rows.append(
            (
                *(Cell(text) for text in cells[:2]),
                Cell(cells[2], strong=True, tone="warn" if edge else ""),
                Cell(cells[3]),
                Cell(_sure(response, item) if response else NONE),
            )
        )
    columns = (
        Column("option", left=True),
        Column("start"),
        Column("tuned"),
        Column("tried"),
        Column(
            "optimum, 95 %",
            "Where it lies as far as these runs tell, the other options as they are; of a choice, the values that are "
            "not shown to be worse.",
        ),
    )
    return Table(f"{name}values", columns, tuple(rows))


def held_out(item: Tuning, name: str = "") -> Table:
    """Start against tuned, by scenario."""
    main = item.objective.measure
    others = [measure for measure in WORDS if measure != main and item.held_out.of(measure)]
    compared = item.held_out.of(main)
    places = decimals([one.start.value for one in compared] + [one.tuned.value for one in compared], 4)
    unit = compared[0].unit if compared else ""
    columns = [
        Column("scenario", left=True),
        Column(f"{WORDS[main]}{f', {unit}' if unit else ''}: start"),
        Column("tuned"),
        Column("difference", "With its 95 % interval, from the same runs.", details="95 % interval"),
        Column("verdict", left=True),
        *(Column(f"{WORDS[measure]}: start, tuned", details="verdict") for measure in others),
    ]
    rows = []
    for one in compared:
        cells = [
            Cell(one.scenario),
            Cell(fixed(one.start.value, places), _ends(one.start, places)),
            Cell(fixed(one.tuned.value, places), _ends(one.tuned, places)),
            Cell(signed(one.difference.value, places), _between(one.difference.ci95, places)),
            Cell(one.verdict, tone=_TONES.get(one.verdict, "")),
        ]
        for measure in others:
            other = next((each for each in item.held_out.of(measure) if each.scenario == one.scenario), None)
            cells.append(_pair(other))
        rows.append(tuple(cells))
    return Table(f"{name}held-out", tuple(columns), tuple(rows))


def response(item: Tuning, name: str = "") -> Table:
    """Which option matters, and how sharply; without choices, of which none is half of another."""
    numbers = [one for one in item.responses if one.parameter.scale != "choice"]
    relative = item.objective.measure != "log_likelihood"
    unit = f"{WORDS[item.objective.measure]}, %" if relative else "log-likelihood"
    one_loss = relative and not any(part.startswith(NEES) for part in item.best.parts)
    others = any(one.parameter.scale != "log" for one in numbers)
    low, high = ("half, or the next below", "twice, or the next above") if others else ("half of it", "twice")
    columns = [
        Column("option", left=True),
        Column("tuned"),
        Column(f"{low}: {unit}", "What changes where this option alone has this value.", details="mean NEES"),
        Column(f"{high}: {unit}", details="mean NEES"),
        *([Column("within 1 % of the optimum")] if one_loss else []),
    ]
    rows = []
    for one in numbers:
        best = item.best.values[one.parameter.key]
        cells = [Cell(one.parameter.key), Cell(shown(best))]
        cells += [_change(point, item.best.parts, one.parameter) for point in _nearest(one, best)]
        if one_loss:
            cells.append(Cell(_ends_of(one.within(NEGLIGIBLE)) if one.parameter.continuous else NONE))
        rows.append(tuple(cells))
    caption = "The option that matters most comes first"
    return Table(f"{name}response", tuple(columns), tuple(rows), caption)


def front(item: Tuning, name: str = "") -> Table:
    """The trials that none beats in both."""
    columns = [
        *(Column(parameter.key) for parameter in item.parameters),
        Column("position RMSE, m"),
        Column("mean NEES"),
    ]
    rows = [
        (
            *(Cell(shown(trial.values[parameter.key])) for parameter in item.parameters),
            Cell(f"{trial.measures.get('position_rmse', math.nan):.4g}", strong=trial.values == item.best.values),
            Cell(f"{trial.measures.get('nees', math.nan):.3g}"),
        )
        for trial in item.front
    ]
    return Table(f"{name}front", tuple(columns), tuple(rows), "On what it was tuned on; the written one stands out")


def trials(item: Tuning, name: str = "") -> Table:
    """The trials, best first."""
    named = dict.fromkeys([*WORDS, item.objective.measure])
    measured = [measure for measure in named if any(measure in trial.measures for trial in item.trials)]
    columns = [*(Column(parameter.key) for parameter in item.parameters), *(Column(WORDS[one]) for one in measured)]
    last = all(trial.values != item.best.values for trial in item.trials)
    tried = [*item.trials, *([item.best] if last else [])]
    done = sorted((trial for trial in tried if trial.losses), key=lambda trial: item.objective.rank(trial.parts))[:MOST]
    rows = [
        (
            *(
                Cell(shown(trial.values[parameter.key]), strong=trial.values == item.best.values)
                for parameter in item.parameters
            ),
            *(Cell(f"{trial.measures[one]:.4g}" if one in trial.measures else NONE) for one in measured),
        )
        for trial in done
    ]
    from_last = ", and come from the last step, each option by itself" if last else ""
    caption = f"Best first, on what it was tuned on; the tuned values stand out{from_last}"
    return Table(f"{name}trials", tuple(columns), tuple(rows), caption)


def _tried(parameter: Parameter) -> str:
    if parameter.scale == "choice":
        return ", ".join(shown(choice) for choice in parameter.choices)
    return f"{shown(parameter.low)} to {shown(parameter.high)}"


def _sure(one: Response, item: Tuning) -> str:
    """How far the runs tell where the optimum is; a price on inconsistency bends the objective too sharply for that."""
    if any(part.startswith(NEES) for part in item.best.parts):
        return NONE
    if not one.parameter.continuous:
        return ", ".join(shown(value) for value in one.as_good)
    return _ends_of(one.optimum95) if one.told else NONE


def _ends_of(ends: tuple[float | None, float | None]) -> str:
    low, high = ends
    if low is None and high is None:
        return "all that was tried"
    if low is None:
        return f"up to {shown(high)}"
    return f"from {shown(low)}" if high is None else f"{shown(low)} to {shown(high)}"


def _nearest(one: Response, best: Any) -> tuple[ResponsePoint | None, ResponsePoint | None]:
    """Half and twice the value; of another scale the values next to it."""
    if one.parameter.scale == "log":
        half, twice = (
            next((point for point in one.points if abs(point.value / best - factor) < 0.01 * factor), None)
            for factor in (0.5, 2.0)
        )
        return half, twice
    place = next(i for i, point in enumerate(one.points) if point.best)
    low = one.points[place - 1] if place > 0 else None
    return low, one.points[place + 1] if place + 1 < len(one.points) else None


def _change(point: ResponsePoint | None, best: Parts, parameter: Parameter) -> Cell:
    """How far the main quantity of the objective is from that of the best values."""
    if point is None or not point.parts:
        return Cell(NONE)
    details = () if parameter.scale == "log" else (f"at {shown(point.value)}",)
    if any(part.startswith(NEES) for part in best):
        details = (*details, f"mean NEES {mean_nees(point.parts):.2g}")
    if "likelihood" in best:
        return Cell(signed(best["likelihood"] - point.parts["likelihood"], 4), details)
    return Cell(signed(100 * math.expm1(point.parts["error"] - best["error"]), 1), details)


def _ends(one: Interval, places: int) -> tuple[str, ...]:
    return _between(one.ci95, places)


def _between(ends: tuple[float, float] | None, places: int) -> tuple[str, ...]:
    return (interval(ends, places),) if ends else ()


def _pair(one: MeasureComparison | None) -> Cell:
    if one is None:
        return Cell(NONE)
    places = decimals([one.start.value, one.tuned.value], 4)
    text = f"{fixed(one.start.value, places)}, {fixed(one.tuned.value, places)}"
    return Cell(text, (one.verdict,))
