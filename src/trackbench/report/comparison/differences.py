"""The differences of a comparison: a table for each metric, and what became of the limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from trackbench.base.errors import counted
from trackbench.compare import Comparison, Entrant, PairDifference
from trackbench.compare.comparison import ComparedResult, ComparedScenario, GateResult, OverallChange
from trackbench.document import Block, Cell, Column, Item, Items, Paragraph, Section, Status, Table, Tone
from trackbench.metrics.differences import EQUIVALENT, UNDECIDED, VERDICTS
from trackbench.report.comparison.figures import difference_figure
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed

TONES: Mapping[str, Tone] = {"better": "good", "worse": "bad"}
_GATE_TONES: Mapping[str, Tone] = {"failed": "bad", "error": "bad", "undecided": "warn"}


def lead(comparison: Comparison) -> str:
    """How many differences there are, and of which kind."""
    return " ".join(f"{metric}: {_counts(items)}." for metric, items in comparison.by_metric())


def _counts(items: Sequence[PairDifference]) -> str:
    found = [item.verdict for item in items]
    return ", ".join(f"{found.count(verdict)} {verdict}" for verdict in VERDICTS if verdict in found)


def blocks(comparison: Comparison, colours: Mapping[str, str], reports: Mapping[str, str]) -> Iterator[Block]:
    """The results, the differences by metric, and the limits."""
    several = len(comparison.scenarios) > 1
    if several:
        yield Items(tuple(Item(label, label=letter(i)) for i, label in enumerate(comparison.sets)))
    else:
        yield Items(tuple(_result(comparison, result) for result in comparison.scenarios[0].results))
    for metric, items in comparison.by_metric():
        yield Section(f"{metric}, {items[0].unit}", tuple(_section(comparison, colours, metric, items)))
    if comparison.gates:
        yield Section("Limits", (*_gates(comparison),))
    if several:
        yield Section("Scenarios", (_scenarios(comparison, reports),))


def _section(
    comparison: Comparison, colours: Mapping[str, str], metric: str, items: Sequence[PairDifference]
) -> Iterator[Block]:
    several = len(comparison.scenarios) > 1
    if several:
        yield _overall(comparison, [item for item in comparison.overall if item.metric == metric])
        yield _changes(comparison, metric, items)
    table, explained = _differences(comparison, metric, items), Paragraph(_explanation(items))
    figure = difference_figure(metric, items, _labels(comparison, items), colours)
    figures = () if all(item.identical for item in items) else (figure,)
    if several:
        yield from (*figures, Section("Each difference", (table, explained), folded=True))
    else:
        yield from (table, explained, *figures)


def _result(comparison: Comparison, result: ComparedResult) -> Item:
    """What is compared, and how."""
    text = f"{result.label}: {counted(result.runs, 'run')}, seed {result.seed}"
    return Item(text, label=letter(result.set) if len(comparison.sets) > 1 else "", detail=_how(result))


def _how(result: ComparedResult) -> str:
    if not result.reason:
        return ""
    return f"{'unpaired' if result.shared_runs is None else 'paired'}: {result.reason}"


def _explanation(items: Sequence[PairDifference]) -> str:
    paired = sorted({(item.paired_runs, item.scenes) for item in items if item.paired_runs is not None})
    ways = [f"paired over {' or '.join(_runs(*found) for found in paired)}"] if paired else []
    ways += ["unpaired (Welch's test)"] if any(item.paired_runs is None for item in items) else []
    corrected = ", corrected for their number (Holm)" if len(items) > 1 else ""
    return (
        "±: 95 %, of the difference; %: of the value that it is held against; margin: up to which it does not matter. "
        f"Differences are {' or '.join(ways)}. Better and worse, larger and smaller: shown to differ by more "
        f"than the margin, at a level of 5 %{corrected}; equivalent: interval within the margin; undecided: neither."
    )


def _runs(runs: int, scenes: int) -> str:
    return f"{scenes} scenes of {counted(runs // scenes, 'run')}" if scenes > 1 else counted(runs, "run")


def _differences(comparison: Comparison, metric: str, items: Sequence[PairDifference]) -> Table:
    """Every difference of a metric."""
    places = _places(items)
    several = len(comparison.scenarios) > 1
    columns = (
        Column("scenario" if several else "tracker", left=True),
        Column("tracker" if several else "against", left=True),
        Column("value"),
        Column("difference"),
        Column("%", "of the value that it is held against"),
        Column("margin", "up to which a difference does not matter"),
        Column("verdict", left=True),
    )
    rows = []
    for item in items:
        tracker = Cell(name(comparison, item.entrant), tracker=item.entrant.tracker)
        against = name(comparison, item.against, item.entrant)
        rows.append(
            (
                *((Cell(item.scenario), tracker) if several else (tracker, Cell(against))),
                Cell(fixed(item.value, places)),
                Cell("0 in every run" if item.identical else _with_reach(item, places)),
                Cell(_percent(item.percent)),
                Cell(fixed(item.margin, places)),
                Cell(item.verdict, tone=TONES.get(item.verdict, "")),
            )
        )
    return Table(f"differences-{metric.replace('.', '-')}", columns, tuple(rows))


def _overall(comparison: Comparison, items: Sequence[OverallChange]) -> Table:
    """Each entrant over all scenarios: in how many it is better, and the mean change."""
    verdicts = [verdict for verdict in VERDICTS if any(verdict in item.verdicts for item in items)]
    rows = [
        (
            Cell(name(comparison, item.entrant), tracker=item.entrant.tracker),
            Cell(name(comparison, item.against, item.entrant)),
            *(Cell(str(item.verdicts.get(verdict, 0))) for verdict in verdicts),
            Cell(_percent(item.mean_percent)),
        )
        for item in items
    ]
    columns = (
        Column("tracker", left=True),
        Column("against", left=True),
        *(Column(verdict, "scenarios") for verdict in verdicts),
        Column("mean %", "geometric mean over the scenarios of the value over that which it is held against, less one"),
    )
    caption = "Number of scenarios by verdict, and the mean change"
    return Table(f"overall-{items[0].metric.replace('.', '-')}", columns, tuple(rows), caption)


def _changes(comparison: Comparison, metric: str, items: Sequence[PairDifference]) -> Table:
    """The change in percent, scenarios down and entrants across."""
    pairs = list(dict.fromkeys((item.entrant, item.against) for item in items))
    found = {(item.scenario, item.entrant): item for item in items}
    rows = []
    for scenario in dict.fromkeys(item.scenario for item in items):
        cells = (found.get((scenario, entrant)) for entrant, _ in pairs)
        rows.append((Cell(scenario), *(Cell("") if item is None else _change(item) for item in cells)))
    columns = (Column("scenario", left=True), *(Column(name(comparison, entrant)) for entrant, _ in pairs))
    caption = "Change in percent; coloured where it is shown to be more than the margin"
    return Table(f"changes-{metric.replace('.', '-')}", columns, tuple(rows), caption, matrix=True)


def _change(item: PairDifference) -> Cell:
    text = "0" if item.identical else _percent(item.percent)
    return Cell(text, tone=TONES.get(item.verdict, ""), strong=item.verdict not in (EQUIVALENT, UNDECIDED))


def _scenarios(comparison: Comparison, reports: Mapping[str, str]) -> Table:
    """The results of each scenario, and how they are compared."""

    def row(scenario: ComparedScenario, result: ComparedResult) -> tuple[Cell, ...]:
        return (
            Cell(scenario.name, link=reports.get(result.label, "")),
            Cell(letter(result.set)),
            Cell(str(result.runs)),
            Cell(str(result.seed)),
            Cell(_how(result)),
        )

    rows = tuple(row(scenario, result) for scenario in comparison.scenarios for result in scenario.results)
    left = ("scenario", "", "compared")
    columns = tuple(Column(text, left=text in left) for text in ("scenario", "", "runs", "seed", "compared"))
    return Table("scenarios", columns, rows)


def _gates(comparison: Comparison) -> Iterator[Block]:
    kept = sum(item.outcome == "passed" for item in comparison.gates)
    items = tuple(_gate(comparison, item) for item in comparison.gates if item.outcome != "passed")
    if items:
        yield Items(items)
    yield Status(f"{kept} of {counted(len(comparison.gates), 'limit')} kept", "good" if comparison.passed else "bad")


def _gate(comparison: Comparison, item: GateResult) -> Item:
    where = f"{item.scenario}, " if len(comparison.scenarios) > 1 else ""
    what = f"{where}{name(comparison, item.entrant)}, {item.metric}: {item.text}"
    return Item(what, label=item.outcome.upper(), tone=_GATE_TONES[item.outcome])


def _places(items: Sequence[PairDifference]) -> int:
    """Decimals that show the values to three digits and the smallest uncertainty to one."""
    widths = [(d.ci95[1] - d.ci95[0]) / 2 for d in items if d.ci95 is not None and not d.identical]
    return max(decimals([item.value for item in items]), decimals(widths, 1) if widths else 0)


def _with_reach(item: PairDifference, places: int) -> str:
    reach = "" if item.ci95 is None else f" ±{fixed((item.ci95[1] - item.ci95[0]) / 2, places)}"
    return fixed(item.difference, places) + reach


def _percent(value: float | None) -> str:
    if value is None:
        return NOT_AVAILABLE
    return ("+" if value > 0 else "") + fixed(value, 1 if abs(value) < 10 else 0)


def _labels(comparison: Comparison, items: Sequence[PairDifference]) -> list[str]:
    """What each difference is of."""
    place = "{0.scenario}, " if len(comparison.scenarios) > 1 else ""
    against = " against {0.against.tracker}" if len(comparison.sets) == 1 else ""
    return [f"{place}{{1}}{against}".format(item, name(comparison, item.entrant)) for item in items]


def name(comparison: Comparison, entrant: Entrant, other: Entrant | None = None) -> str:
    """As short as tells two entrants apart."""
    if len(comparison.sets) == 1:
        return entrant.tracker
    if other is not None and entrant.tracker == other.tracker:
        return letter(entrant.set)
    return f"{entrant.tracker} {letter(entrant.set)}"


def letter(number: int) -> str:
    """Of a set of results."""
    return chr(ord("A") + number) if number < 26 else str(number + 1)
