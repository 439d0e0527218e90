"""Trackers over scenarios: who is ahead, and each tracker's metrics in each scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from trackbench.base.errors import counted
from trackbench.compare import Comparison
from trackbench.compare.comparison import EntrantScore
from trackbench.document import Block, Cell, Column, Item, Items, Paragraph, Section, Table
from trackbench.metrics.covariance_words import BRIEF, verdict_in_words
from trackbench.metrics.verdicts import mean_text
from trackbench.report.comparison.figures import competitors, ranked_label
from trackbench.report.comparison.over_scenarios import scenario_table, who_is_ahead
from trackbench.report.comparison.sentences import NAMES, world_tables
from trackbench.report.numbers import NOT_AVAILABLE, decimals, joined_names, reach_text, short
from trackbench.report.tables import tone_of
from trackbench.report.verdicts import COMPARED

_ToCell = Callable[[EntrantScore, int], Cell]
#: Metrics of the matrices by title, for known and for hidden identities.
_OF_ESTIMATES = {
    "Position RMSE, m": "position_rmse",
    "Velocity RMSE, m/s": "velocity_rmse",
    "Does each tracker know its own error?": "nees",
}
_OF_TRACKS = {
    "T-GOSPA, m": "tgospa",
    "GOSPA, m": "gospa",
    "HOTA": "hota",
    "Switches a minute of an object": "id_switches",
}


#: Note on the values of the metric that ranks.
_BOLD = (
    "Beside a value is its 95 % interval, if any. Bold: the best of the scenario, and every tracker not shown to be "
    "worse than it."
)


def ranking_blocks(comparison: Comparison, reports: Mapping[str, str]) -> Iterator[Block]:
    """Yield the answer, the differences from the baseline, a matrix for each metric, the scenarios and the failures."""
    if len(competitors(comparison)) > 1:
        yield Paragraph(who_is_ahead(comparison), strong=True)
    for metric in dict.fromkeys(change.metric for change in comparison.overall):
        name = NAMES.get(metric, metric)
        title = f"{name[0].upper()}{name[1:]} against {comparison.baseline}"
        words = COMPARED["words"].format(
            over=f"All {len(comparison.scenarios)}", family="all worlds" if comparison.worlds else "a scenario"
        )
        shared = [joined_names(names) for names in comparison.sets_of_scenes if len(names) > 1]
        words += f" {COMPARED['shared scenes'].format(listed='; '.join(shared))}" if shared else ""
        yield Section(title, (scenario_table(comparison, metric), Paragraph(words)))
    if comparison.worlds:
        yield Section("In which worlds does it hold?", tuple(world_tables(comparison)))
    links = {s.name: reports.get(s.results[0].label, "") for s in comparison.scenarios}
    matrices = _OF_TRACKS if comparison.ranked_by == "tgospa" else _OF_ESTIMATES
    for title, metric in matrices.items():
        is_ranked = metric == comparison.ranked_by
        cell = _ranked_cell(metric) if is_ranked else _nees_cell if metric == "nees" else _plain_cell(metric)
        table = _matrix(comparison, links, metric.replace("_", "-"), metric, cell)
        yield Section(title, (table, *([Paragraph(_BOLD)] if is_ranked else [])))
    yield Section("Scenarios", (_scenarios(comparison, links),))
    failures = [
        Item(f"in {score.scenario}: {score.failure}", label=score.entrant.tracker, tone="bad")
        for score in comparison.scores
        if score.failure
    ]
    if failures:
        yield Section("Without a score", (Items(tuple(failures)),))


def _matrix(comparison: Comparison, links: Mapping[str, str], name: str, metric: str, cell: _ToCell) -> Table:
    """Return a table of one metric, with scenarios as rows and trackers as columns in the order of the ranking."""
    rows = []
    for scenario in comparison.scenarios:
        scores = {score.entrant.tracker: score for score in comparison.scores if score.scenario == scenario.name}
        places = decimals([score.value(metric) for score in scores.values()])
        ranked = [scores.get(item.tracker) for item in comparison.ranking]
        cells = (Cell("") if score is None else cell(score, places) for score in ranked)
        rows.append((Cell(scenario.name, link=links[scenario.name]), *cells))
    columns = (Column("scenario", left=True), *(Column(ranked_label(item)) for item in comparison.ranking))
    return Table(name, columns, tuple(rows))


def _plain_cell(metric: str) -> _ToCell:
    def cell(score: EntrantScore, places: int) -> Cell:
        value = score.metrics.get(metric)
        if value is None:
            return Cell("failed", tone="bad") if score.failure else Cell(NOT_AVAILABLE)
        return Cell(short(value.value, places), tuple(filter(None, [reach_text(value.value, value.ci95, places)])))

    return cell


def _ranked_cell(metric: str) -> _ToCell:
    def cell(score: EntrantScore, places: int) -> Cell:
        plain = _plain_cell(metric)(score, places)
        diverged = (f"{counted(score.diverged_runs, 'run')} diverged",) if score.diverged_runs else ()
        return replace(plain, details=(*plain.details, *diverged), strong=score.leading)

    return cell


def _nees_cell(score: EntrantScore, _: int) -> Cell:
    nees = score.metrics.get("nees")
    if nees is None or nees.verdict is None:
        return Cell(NOT_AVAILABLE)
    assert nees.value is not None
    words, brief = verdict_in_words(nees, whole=False), BRIEF.get(nees.verdict, "")
    return Cell(mean_text(nees.value), (words,), brief=brief, tone=tone_of(nees))


def _scenarios(comparison: Comparison, links: Mapping[str, str]) -> Table:
    """Return a table of each scenario's description, runs, seed and met expectations."""
    scenarios = comparison.scenarios
    results = [scenario.results[0] for scenario in scenarios]
    met = [f"{r.expectations_met} of {r.expectations} met" if r.expectations else "none stated" for r in results]
    columns = [
        (Column("scenario", left=True), [Cell(item.name, link=links[item.name]) for item in scenarios]),
        (Column("what it shows", left=True), [Cell(item.description) for item in scenarios]),
        (Column("runs"), [Cell(str(result.runs)) for result in results]),
        (Column("seed"), [Cell(str(result.seed)) for result in results]),
        (Column("expectations"), list(map(Cell, met))),
    ]
    return Table.of_columns("scenarios", columns)
