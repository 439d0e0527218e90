"""The differences of a comparison: a table for each metric, and what became of the limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from trackbench.base.errors import counted
from trackbench.compare import Comparison, Entrant, PairDifference
from trackbench.compare.comparison import ComparedResult, OverallChange
from trackbench.document import Block, Cell, Code, Column, Item, Items, Paragraph, Section, Status, Table, Tone
from trackbench.document.palette import Styles
from trackbench.metrics.differences import EQUIVALENT, UNDECIDED, VERDICTS
from trackbench.report.comparison.figures import difference_figure
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, short
from trackbench.report.tables import unit_of

TONES: Mapping[str, Tone] = {"better": "good", "worse": "bad"}
_GATE_TONES: Mapping[str, Tone] = {"failed": "bad", "error": "bad", "undecided": "warn"}


def lead(comparison: Comparison) -> str:
    """How many differences there are, and of which kind."""
    sentences = []
    for metric, items in comparison.by_metric():
        words = [item.verdict for item in items]
        counts = ", ".join(f"{words.count(verdict)} {verdict}" for verdict in VERDICTS if verdict in words)
        sentences.append(f"{metric}: {counts}.")
    return " ".join(sentences)


def blocks(comparison: Comparison, styles: Styles, reports: Mapping[str, str]) -> Iterator[Block]:
    """The results, the differences by metric, and the limits."""
    several = len(comparison.scenarios) > 1
    if several:
        yield Items(tuple(Item(label, label=letter(i)) for i, label in enumerate(comparison.sets)))
    else:
        yield Items(
            tuple(
                Item(
                    f"{result.label}: {counted(result.runs, 'run')}, seed {result.seed}",
                    label=letter(result.set) if len(comparison.sets) > 1 else "",
                    detail=_how(result),
                )
                for result in comparison.scenarios[0].results
            )
        )
    for metric, items in comparison.by_metric():
        yield Section(f"{metric}{unit_of(items[0].unit)}", tuple(_section(comparison, styles, metric, items)))
    yield from reproduction(comparison)
    if comparison.gates:
        yield Section("Limits", (*_gates(comparison),))
    if several:
        yield Section("Scenarios", (_scenarios(comparison, reports),))


def _section(comparison: Comparison, styles: Styles, metric: str, items: Sequence[PairDifference]) -> Iterator[Block]:
    several = len(comparison.scenarios) > 1
    if several:
        yield _overall(comparison, [item for item in comparison.overall if item.metric == metric])
        yield _changes(comparison, metric, items)
    table = _differences(comparison, metric, items)
    explained = Paragraph(_explanation(items, len(comparison.differences)))
    figure = difference_figure(metric, items, _labels(comparison, items), styles)
    figures = () if all(item.identical for item in items) else (figure,)
    if several:
        yield from (*figures, Section("Each difference", (table, explained), folded=True))
    else:
        yield from (table, explained, *figures)


def reproduction(comparison: Comparison) -> Iterator[Block]:
    """The commands that make it again, where they are known."""
    if comparison.commands:
        yield Section("Reproduce", (Code("\n".join(comparison.commands), "sh"),))


def _how(result: ComparedResult) -> str:
    if not result.reason:
        return ""
    return f"{'unpaired' if result.shared_runs is None else 'paired'}: {result.reason}"


def _explanation(items: Sequence[PairDifference], number: int) -> str:
    """``number``: of the differences by all metrics."""
    ways = []
    if paired := sorted({(item.paired_runs, item.scenes, item.stretches or 0) for item in items if item.paired_runs}):
        ways.append(f"paired over {' or '.join(_parts(*each) for each in paired)}")
    if any(item.paired_runs is None for item in items):
        ways.append("unpaired (Welch's test)")
    together = "" if number == len(items) else " by all metrics together"
    corrected = f", corrected for their number{together} (Holm)" if number > 1 else ""
    few = all(item.ci95 is None and item.p_value == 1 for item in items)
    untested = " There are too few runs or scenes to test any." if few else ""
    return (
        "±: 95 %, of the difference; %: of the value that it is held against; margin: up to which it does not matter. "
        f"Differences are {' or '.join(ways)}. Better and worse, larger and smaller: shown to differ by more "
        f"than the margin, at a level of 5 %{corrected}; equivalent: interval within the margin; undecided: neither."
        f"{untested}"
    )


def _parts(runs: int, scenes: int, stretches: int) -> str:
    """What differences are paired over."""
    of = f"{scenes} scenes of {counted(runs // scenes, 'run')}" if scenes > 1 else counted(runs, "run")
    return f"{stretches} stretch{'es' * (stretches > 1)} of time of {of}" if stretches else of


def _differences(comparison: Comparison, metric: str, items: Sequence[PairDifference]) -> Table:
    """Every difference of a metric: decimals show the values to three digits and the smallest uncertainty to one."""
    widths = [(d.ci95[1] - d.ci95[0]) / 2 for d in items if d.ci95 is not None and not d.identical]
    places = max(decimals([item.value for item in items]), decimals(widths, 1) if widths else 0)

    def with_reach(item: PairDifference) -> str:
        reach = "" if item.ci95 is None else f" ±{short((item.ci95[1] - item.ci95[0]) / 2, places)}"
        return "0 in every run" if item.identical else short(item.difference, places) + reach

    tracker = (Column("tracker", left=True), [_name_cell(comparison, item) for item in items])
    if len(comparison.scenarios) > 1:
        first = [(Column("scenario", left=True), [Cell(item.scenario) for item in items]), tracker]
    else:
        first = [tracker, (Column("against", left=True), [_against_cell(comparison, item) for item in items])]
    columns = [
        *first,
        (Column("value"), [Cell(short(item.value, places)) for item in items]),
        (Column("difference"), [Cell(with_reach(item)) for item in items]),
        (Column("%", "of the value that it is held against"), [Cell(_percent(item.percent)) for item in items]),
        (
            Column("margin", "up to which a difference does not matter"),
            [Cell(short(item.margin, places)) for item in items],
        ),
        (Column("verdict", left=True), [Cell(item.verdict, tone=TONES.get(item.verdict, "")) for item in items]),
    ]
    return Table.of_columns(f"differences-{metric.replace('.', '-')}", columns)


def _name_cell(comparison: Comparison, item: PairDifference | OverallChange) -> Cell:
    return Cell(name(comparison, item.entrant), tracker=item.entrant.tracker)


def _against_cell(comparison: Comparison, item: PairDifference | OverallChange) -> Cell:
    return Cell(name(comparison, item.against, item.entrant))


def _overall(comparison: Comparison, items: Sequence[OverallChange]) -> Table:
    """Each entrant over all scenarios: in how many it is better, and the mean change."""
    mean = "geometric mean over the scenarios of the value over that which it is held against, less one"
    columns = [
        (Column("tracker", left=True), [_name_cell(comparison, item) for item in items]),
        (Column("against", left=True), [_against_cell(comparison, item) for item in items]),
        *(
            (Column(verdict, "scenarios"), [Cell(str(item.verdicts.get(verdict, 0))) for item in items])
            for verdict in VERDICTS
            if any(verdict in item.verdicts for item in items)
        ),
        (Column("mean %", mean), [Cell(_percent(item.mean_percent)) for item in items]),
    ]
    caption = "Number of scenarios by verdict, and the mean change"
    return Table.of_columns(f"overall-{items[0].metric.replace('.', '-')}", columns, caption)


def _changes(comparison: Comparison, metric: str, items: Sequence[PairDifference]) -> Table:
    """The change in percent, scenarios down and entrants across."""
    entrants = list(dict.fromkeys(item.entrant for item in items))
    by_entrant = {(item.scenario, item.entrant): item for item in items}

    def cell(scenario: str, entrant: Entrant) -> Cell:
        item = by_entrant.get((scenario, entrant))
        if item is None:
            return Cell("")
        text, strong = "0" if item.identical else _percent(item.percent), item.verdict not in (EQUIVALENT, UNDECIDED)
        return Cell(text, tone=TONES.get(item.verdict, ""), strong=strong)

    scenarios = dict.fromkeys(item.scenario for item in items)
    rows = tuple((Cell(scenario), *(cell(scenario, entrant) for entrant in entrants)) for scenario in scenarios)
    columns = (Column("scenario", left=True), *(Column(name(comparison, entrant)) for entrant in entrants))
    caption = "Change in percent; coloured where it is shown to be more than the margin"
    return Table(f"changes-{metric.replace('.', '-')}", columns, rows, caption)


def _scenarios(comparison: Comparison, reports: Mapping[str, str]) -> Table:
    """The results of each scenario, and how they are compared."""
    rows = [(scenario.name, result) for scenario in comparison.scenarios for result in scenario.results]
    columns = [
        (Column("scenario", left=True), [Cell(title, link=reports.get(result.label, "")) for title, result in rows]),
        (Column("", left=True), [Cell(letter(result.set)) for _, result in rows]),
        (Column("runs"), [Cell(str(result.runs)) for _, result in rows]),
        (Column("seed"), [Cell(str(result.seed)) for _, result in rows]),
        (Column("compared", left=True), [Cell(_how(result)) for _, result in rows]),
    ]
    return Table.of_columns("scenarios", columns)


def _gates(comparison: Comparison) -> Iterator[Block]:
    missed = [item for item in comparison.gates if item.outcome != "passed"]
    several = len(comparison.scenarios) > 1
    if missed:
        yield Items(
            tuple(
                Item(
                    f"{f'{item.scenario}, ' if several else ''}{name(comparison, item.entrant)}, "
                    f"{item.metric}: {item.text}",
                    label=item.outcome.upper(),
                    tone=_GATE_TONES[item.outcome],
                )
                for item in missed
            )
        )
    yield kept_limits([item.outcome for item in comparison.gates], comparison.passed)


def kept_limits(outcomes: Sequence[str], passed: bool) -> Status:
    """How many limits are kept, and how many are undecided."""
    kept, undecided = (outcomes.count(outcome) for outcome in ("passed", "undecided"))
    words = f"{kept} of {counted(len(outcomes), 'limit')} kept{f', {undecided} undecided' if undecided else ''}"
    return Status(words, "good" if passed else "bad")


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
