"""Trackers over scenarios: the ranking, and what each tracker reached in each scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from trackbench.base.errors import counted
from trackbench.compare import Comparison
from trackbench.compare.comparison import EntrantScore
from trackbench.compare.ranking import FEWEST_SCENARIOS, FEWEST_TRACKERS, fewest_scenarios
from trackbench.document import Block, Cell, Column, Item, Items, Paragraph, Section, Table
from trackbench.metrics.verdicts import conditions_off
from trackbench.report.comparison.figures import competitors, label, rank_figure, reference_figure
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, interval
from trackbench.report.tables import TONE

_RANKED = (
    "With half of its 95 % interval. Bold: the best of the scenario, and every tracker that was not shown to be worse "
    "than it by more than the margin (paired over runs, Holm)."
)
_NEES = (
    "Mean NEES, which should be 4. Optimistic: errors are larger than the tracker states; pessimistic: smaller; mixed: "
    "off under the conditions that are named and not under others; undecided: too few runs or scenes to say."
)
_TIME = "Of one predict and update of one run, on this machine."

_ToCell = Callable[[EntrantScore, int], Cell]
#: The metrics that rank, in words.
NAMES = {"position_rmse": "position RMSE", "gospa": "GOSPA"}
_Matrix = Callable[[str, str, _ToCell], Table]
#: Where identities are hidden, what is shown beside GOSPA: title, metric.
_OF_TRACKS = {
    "Localisation part of GOSPA, m": "gospa_localisation",
    "Missed part of GOSPA, m": "gospa_missed",
    "False part of GOSPA, m": "gospa_false",
    "HOTA": "hota",
    "Switches a minute of an object": "id_switches",
}


def lead(comparison: Comparison) -> str:
    """What was compared, who is ahead, and how certain that is."""
    ranking, scenarios = competitors(comparison), len(comparison.scenarios)
    compared = f"{counted(len(ranking), 'tracker')} over {counted(scenarios, 'scenario')}. "
    if len(ranking) < 2:
        return compared
    first, second = ranking[:2]
    if first.mean_rank == second.mean_rank:
        ahead = [item.tracker for item in ranking if item.mean_rank == first.mean_rank]
        return (
            f"{compared}{', '.join(ahead[:-1])} and {ahead[-1]} share the best mean rank, {fixed(first.mean_rank, 2)}."
        )
    ranks = f"{fixed(first.mean_rank, 2)} against {fixed(second.mean_rank, 2)} of {second.tracker}"
    return f"{compared}{first.tracker} has the best mean rank, {ranks}. {_certainty(comparison)}"


def _certainty(comparison: Comparison) -> str:
    """Whether the lead is shown."""
    ranking, scenarios = competitors(comparison), len(comparison.scenarios)
    wanted = fewest_scenarios(len(ranking))
    if scenarios < wanted:
        trackers = counted(len(ranking), "tracker")
        return f"Too few scenarios for a claim: with {trackers} it takes {wanted}."
    rivals = [item for item in comparison.rank_differences if ranking[0].tracker in (item.a, item.b)]
    p_value = f"p = {fixed(max(item.p_value for item in rivals), 3)}"
    return (
        f"That lead is shown ({p_value})." if all(i.shown for i in rivals) else f"That lead is not shown ({p_value})."
    )


def blocks(
    comparison: Comparison, colours: Mapping[str, str], reports: Mapping[str, str], *, times: bool
) -> Iterator[Block]:
    """The ranking, a matrix for each quantity, the scenarios, and what has no score."""
    yield Section(
        "Overall",
        (
            _overall(comparison),
            Paragraph(_METHOD.format(metric=NAMES[comparison.ranked_by])),
            rank_figure(comparison, colours),
        ),
    )
    links = {s.name: reports.get(s.results[0].label, "") for s in comparison.scenarios}

    def matrix(name: str, metric: str, cell: _ToCell) -> Table:
        return _matrix(comparison, links, name, metric, cell)

    hidden = comparison.ranked_by == "gospa"
    yield from _tracks(matrix) if hidden else _estimates(comparison, matrix)
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
    yield Section("Position RMSE, m", (Paragraph(_RANKED), position, reference_figure(comparison)))
    velocity = matrix("velocity", "velocity_rmse", _plain("velocity_rmse"))
    yield Section("Velocity RMSE, m/s", (Paragraph("With half of its 95 % interval."), velocity))
    yield Section("Does each tracker know its own error?", (Paragraph(_NEES), matrix("nees", "nees", _nees)))


def _tracks(matrix: _Matrix) -> Iterator[Block]:
    yield Section("GOSPA, m", (Paragraph(_RANKED), matrix("gospa", "gospa", _ranked("gospa"))))
    for title, metric in _OF_TRACKS.items():
        yield Section(title, (matrix(metric.replace("_", "-"), metric, _plain(metric)),))


_METHOD = (
    "Rank by {metric} within each scenario, averaged: 1, and 1 more for each tracker that is shown to be better "
    "by more than the margin (paired over runs, 5 % level after Holm), a half for each where neither is. Won, lost and "
    "tied count the same pairings. The interval, and the p-value of the lead, are about scenarios of this kind, each "
    "with as many runs: both the choice of scenarios and the noise within them are in the spread of the ranks. Two "
    "mean ranks differ where few choices of the signs of their differences in the scenarios give as large a sum (exact "
    f"sign-flip test, Holm over the pairs). No interval with fewer than {FEWEST_SCENARIOS} scenarios or "
    f"{FEWEST_TRACKERS} trackers. A reference knows which detection is whose, or later measurements too: the "
    "others are ranked without it, and its rank is that which it would have."
)


def _overall(comparison: Comparison) -> Table:
    """Every tracker over all scenarios, best first."""
    known = comparison.ranked_by == "position_rmse"
    headings = ["mean rank", "95 % interval", "won", "lost", "tied"]
    headings += ["consistent", "diverged runs"] if known else []
    columns = [Column("", left=True), Column("tracker", left=True), *(Column(text) for text in headings)]
    columns.append(Column("scenarios"))
    rows = [
        (
            Cell("" if item.reference else str(i)),
            Cell(item.tracker, ("reference",) if item.reference else (), tracker=item.tracker),
            Cell(fixed(item.mean_rank, 2)),
            Cell(interval(item.ci95, 2) or NOT_AVAILABLE),
            Cell(str(item.won)),
            Cell(str(item.lost)),
            Cell(str(item.tied)),
            *(
                (Cell(f"{item.consistent_scenarios} of {item.judged_scenarios}"), Cell(str(item.diverged_runs)))
                if known
                else ()
            ),
            Cell(str(item.scenarios), (f"{item.failed_scenarios} without a score",) if item.failed_scenarios else ()),
        )
        for i, item in enumerate(comparison.ranking, 1)
    ]
    return Table("ranking", tuple(columns), tuple(rows))


def _matrix(comparison: Comparison, links: Mapping[str, str], name: str, metric: str, cell: _ToCell) -> Table:
    """One metric, scenarios down and trackers across in the order of the ranking."""
    names = [item.tracker for item in comparison.ranking]
    rows = []
    for scenario in comparison.scenarios:
        scores = {score.entrant.tracker: score for score in comparison.scores if score.scenario == scenario.name}
        places = decimals([score.value(metric) for score in scores.values()])
        cells = (scores.get(tracker) for tracker in names)
        link = Cell(scenario.name, link=links[scenario.name])
        rows.append((link, *(Cell("") if score is None else cell(score, places) for score in cells)))
    columns = (
        Column("scenario", left=True),
        *(Column(label(item)) for item in comparison.ranking),
    )
    return Table(name, columns, tuple(rows), matrix=True)


def _plain(metric: str) -> _ToCell:
    """A value with half of its interval."""

    def cell(score: EntrantScore, places: int) -> Cell:
        found = score.metrics.get(metric)
        if found is None:
            return Cell("failed", tone="bad") if score.rank is None else Cell(NOT_AVAILABLE)
        reach = () if found.ci95 is None else (f"±{fixed((found.ci95[1] - found.ci95[0]) / 2, places)}",)
        return Cell(fixed(found.value, places), reach)

    return cell


def _ranked(metric: str) -> _ToCell:
    """The metric that ranks, with the runs that diverged; the best stand out."""
    plain = _plain(metric)

    def cell(score: EntrantScore, places: int) -> Cell:
        found = plain(score, places)
        diverged = (f"{counted(score.diverged_runs, 'run')} diverged",) if score.diverged_runs else ()
        return Cell(found.text, (*found.details, *diverged), found.tone, strong=score.leading)

    return cell


def _nees(score: EntrantScore, _: int) -> Cell:
    found = score.metrics.get("nees")
    if found is None or found.verdict is None:
        return Cell(NOT_AVAILABLE)
    named = conditions_off(found, 2) if found.verdict == "mixed" else ""
    details = tuple(text for text in (found.verdict, named) if text)
    return Cell(fixed(found.value, 1), details, TONE.get(found.verdict, ""))


def _scenarios(comparison: Comparison, links: Mapping[str, str]) -> Table:
    """What each scenario is, and whether its expectations were met."""
    rows = []
    for scenario in comparison.scenarios:
        result = scenario.results[0]
        met = f"{result.expectations_met} of {result.expectations} met" if result.expectations else "none stated"
        cells = scenario.description, str(result.runs), str(result.seed), met
        rows.append((Cell(scenario.name, link=links[scenario.name]), *(Cell(text) for text in cells)))
    left = ("scenario", "what it shows")
    headings = ("scenario", "what it shows", "runs", "seed", "expectations")
    return Table("scenarios", tuple(Column(text, left=text in left) for text in headings), tuple(rows))
