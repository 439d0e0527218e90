"""Trackers over scenarios: the ranking, and what each tracker reached in each scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from trackbench.base.errors import counted
from trackbench.compare import Comparison
from trackbench.compare.comparison import EntrantScore
from trackbench.compare.ranking import FEWEST_SETS, FEWEST_TRACKERS
from trackbench.document import Block, Cell, Column, Item, Items, Paragraph, Row, Section, Table
from trackbench.document.palette import Styles
from trackbench.metrics.verdicts import NAMED, mean_text, only_where, what_is_off
from trackbench.report.comparison.figures import rank_figure, ranked_label, reference_figure
from trackbench.report.comparison.sentences import NAMES, compared, ranking_answer, worlds_section
from trackbench.report.numbers import NOT_AVAILABLE, REACH, decimals, interval_text, reach_text, rounded, short
from trackbench.report.tables import tone_of

_RANKED = (
    f"With {REACH}. Bold: the best of the scenario, and every tracker that was not shown to be worse "
    "than it by more than the margin (paired over runs; 5 % in each scenario, with all of its worlds, Holm over the "
    "pairs)."
)
_NEES = (
    "Mean NEES, which should be 4. Optimistic: errors are larger than the tracker states; pessimistic: smaller; where "
    "the mean is undecided, what is off is named; mixed: off under the conditions that are named and not under others; "
    "heavy-tailed: too many errors are large; undecided: too few runs or scenes, or too many missing estimates, to say."
)
_TIME = "Of one predict and update of one run, on this machine."

_ToCell = Callable[[EntrantScore, int], Cell]
_Matrix = Callable[[str, str, _ToCell], Table]
#: Where identities are hidden, what is shown beside T-GOSPA: title, metric.
_OF_TRACKS = {
    "GOSPA, m": "gospa",
    "HOTA": "hota",
    "Switches a minute of an object": "id_switches",
}
#: The parts of T-GOSPA and GOSPA, which the page that is kept leaves to the data beside it.
_PARTS = {
    "Part of T-GOSPA from switches, m": "gospa_switch",
    "Localisation part of GOSPA, m": "gospa_localisation",
    "Missed part of GOSPA, m": "gospa_missed",
    "False part of GOSPA, m": "gospa_false",
}


def ranking_blocks(
    comparison: Comparison, styles: Styles, reports: Mapping[str, str], *, times: bool
) -> Iterator[Block]:
    """The ranking, a matrix for each quantity, the scenarios, and what has no score."""
    if answer := ranking_answer(comparison):
        yield Paragraph(answer, strong=True)
    yield Paragraph(compared(comparison))
    method = Paragraph(_METHOD.format(metric=NAMES[comparison.ranked_by]))
    how = Section("How it is ranked", (method,), folded=True)
    yield Section("Overall", (Row((rank_figure(comparison, styles),)), _overall(comparison), how))
    if comparison.worlds:
        yield worlds_section(comparison)
    links = {s.name: reports.get(s.results[0].label, "") for s in comparison.scenarios}

    def matrix(name: str, metric: str, cell: _ToCell) -> Table:
        return _matrix(comparison, links, name, metric, cell)

    hidden = comparison.ranked_by == "tgospa"
    yield from _tracks(matrix, with_parts=times) if hidden else _estimates(comparison, matrix)
    if times:
        yield Section("Time of a step, µs", (Paragraph(_TIME), matrix("time", "step_time", _plain("step_time"))))
    yield Section("Scenarios", (_scenarios(comparison, links),))
    failures = [
        Item(f"in {score.scenario}: {score.failure}", label=score.entrant.tracker, tone="bad")
        for score in comparison.scores
        if score.failure
    ]
    if failures:
        yield Section("Without a score", (Items(tuple(failures)),))


def _estimates(comparison: Comparison, matrix: _Matrix) -> Iterator[Block]:
    position = matrix("position", "position_rmse", _ranked("position_rmse"))
    yield Section("Position RMSE, m", (Row((reference_figure(comparison),)), position, Paragraph(_RANKED)))
    velocity = matrix("velocity", "velocity_rmse", _plain("velocity_rmse"))
    yield Section("Velocity RMSE, m/s", (Paragraph(f"With {REACH}."), velocity))
    yield Section("Does each tracker know its own error?", (Paragraph(_NEES), matrix("nees", "nees", _nees)))


def _tracks(matrix: _Matrix, *, with_parts: bool) -> Iterator[Block]:
    yield Section("T-GOSPA, m", (Paragraph(_RANKED), matrix("tgospa", "tgospa", _ranked("tgospa"))))
    for title, metric in (_OF_TRACKS | (_PARTS if with_parts else {})).items():
        yield Section(title, (matrix(metric.replace("_", "-"), metric, _plain(metric)),))


_METHOD = (
    "Rank by {metric} within each scenario, averaged: 1, and 1 more for each tracker that is shown to be better "
    "by more than the margin (paired over runs; 5 % in each scenario, with all of its worlds, Holm over the pairs), "
    "a half for each where "
    "neither is. Won, lost and tied count the same pairings. Scenarios that share scenes are one set, whose rank is "
    "the mean of theirs. The interval, and the p-value of the lead, are about sets of this kind, each with as many "
    "runs: both the choice of scenes and the noise within them are in the spread of the ranks. Two mean ranks differ "
    "where few choices of the signs of their differences in the sets give as large a sum (exact sign-flip test, Holm "
    f"over the pairs). No interval with fewer than {FEWEST_SETS} sets or "
    f"{FEWEST_TRACKERS} trackers. A reference knows which detection is whose, or later measurements too: the "
    "others are ranked without it, and its rank is that which it would have."
)


def _overall(comparison: Comparison) -> Table:
    """Every tracker over all scenarios, best first."""
    items = comparison.ranking
    ranks = ["" if item.reference else str(i) for i, item in enumerate(items, 1)]
    names = [Cell(item.tracker, ("reference",) if item.reference else (), tracker=item.tracker) for item in items]
    texts = {
        "mean rank": [rounded(item.mean_rank, 2) for item in items],
        "95 % interval": [interval_text(item.ci95, 2) or NOT_AVAILABLE for item in items],
        "won": [str(item.won) for item in items],
        "lost": [str(item.lost) for item in items],
        "tied": [str(item.tied) for item in items],
    }
    if comparison.ranked_by == "position_rmse":
        texts["consistent"] = [f"{item.consistent_scenarios} of {item.judged_scenarios}" for item in items]
        texts["diverged runs"] = [str(item.diverged_runs) for item in items]
    failed = [(f"{item.failed_scenarios} without a score",) if item.failed_scenarios else () for item in items]
    columns = [
        (Column(""), list(map(Cell, ranks))),
        (Column("tracker", left=True), names),
        *((Column(heading), list(map(Cell, column))) for heading, column in texts.items()),
        (Column("scenarios"), [Cell(str(item.scenarios), note) for item, note in zip(items, failed, strict=True)]),
    ]
    return Table.of_columns("ranking", columns)


def _matrix(comparison: Comparison, links: Mapping[str, str], name: str, metric: str, cell: _ToCell) -> Table:
    """One metric, scenarios down and trackers across in the order of the ranking."""
    rows = []
    for scenario in comparison.scenarios:
        scores = {score.entrant.tracker: score for score in comparison.scores if score.scenario == scenario.name}
        places = decimals([score.value(metric) for score in scores.values()])
        own = [scores.get(item.tracker) for item in comparison.ranking]
        cells = (Cell("") if score is None else cell(score, places) for score in own)
        rows.append((Cell(scenario.name, link=links[scenario.name]), *cells))
    columns = (Column("scenario", left=True), *(Column(ranked_label(item)) for item in comparison.ranking))
    return Table(name, columns, tuple(rows))


def _plain(metric: str) -> _ToCell:
    """A value with half of its interval."""

    def cell(score: EntrantScore, places: int) -> Cell:
        value = score.metrics.get(metric)
        if value is None:
            return Cell("failed", tone="bad") if score.rank is None else Cell(NOT_AVAILABLE)
        return Cell(short(value.value, places), tuple(filter(None, [reach_text(value.value, value.ci95, places)])))

    return cell


def _ranked(metric: str) -> _ToCell:
    """The metric that ranks, with the runs that diverged; the best stand out."""

    def cell(score: EntrantScore, places: int) -> Cell:
        plain = _plain(metric)(score, places)
        diverged = (f"{counted(score.diverged_runs, 'run')} diverged",) if score.diverged_runs else ()
        return replace(plain, details=(*plain.details, *diverged), strong=score.leading)

    return cell


def _nees(score: EntrantScore, _: int) -> Cell:
    nees = score.metrics.get("nees")
    if nees is None or nees.verdict is None:
        return Cell(NOT_AVAILABLE)
    assert nees.value is not None
    off = [what_is_off(nees, 2, word) for word in (nees.verdict, nees.also) if word in NAMED]
    details = tuple(text for text in (nees.words, only_where(nees), *off) if text)
    return Cell(mean_text(nees.value), details, tone_of(nees))


def _scenarios(comparison: Comparison, links: Mapping[str, str]) -> Table:
    """What each scenario is, and whether its expectations were met."""
    scenarios = comparison.scenarios
    first = [scenario.results[0] for scenario in scenarios]
    met = [f"{r.expectations_met} of {r.expectations} met" if r.expectations else "none stated" for r in first]
    columns = [
        (Column("scenario", left=True), [Cell(item.name, link=links[item.name]) for item in scenarios]),
        (Column("what it shows", left=True), [Cell(item.description) for item in scenarios]),
        (Column("runs"), [Cell(str(result.runs)) for result in first]),
        (Column("seed"), [Cell(str(result.seed)) for result in first]),
        (Column("expectations"), list(map(Cell, met))),
    ]
    return Table.of_columns("scenarios", columns)
