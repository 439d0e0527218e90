"""The tables and sentences of the comparison over scenarios, free of any markup."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, interval, percent
from trackbench.report.standings import RESAMPLES, ScenarioScores, Score, Standing
from trackbench.report.tables import TONE, Cell, Table
from trackbench.words import counted

#: Mean ranks with a lead at least this frequent are called certain.
_CERTAIN = 0.95

MATRIX = (
    "With half of its 95 % interval. Bold: the best of the scenario, and every tracker from which no difference to "
    "the best was shown (paired over runs, Holm)."
)
HONESTY = (
    "Mean NEES, which should be 4. Optimistic: errors are larger than the tracker claims; pessimistic: smaller; "
    "undecided: too few runs to say."
)


def lead(scenarios: Sequence[ScenarioScores], standings: Sequence[Standing]) -> str:
    """What was compared, who is ahead, and how certain that is."""
    compared = f"{counted(len(standings), 'tracker')} over {counted(len(scenarios), 'scenario')}. "
    return compared + _lead(standings)


def _lead(standings: Sequence[Standing]) -> str:
    if len(standings) < 2:
        return ""
    first, second = standings[:2]
    ranks = f"{fixed(first.mean_rank, 2)} against {fixed(second.mean_rank, 2)} of {second.tracker}"
    text = f"{first.tracker} has the best mean rank, {ranks}"
    if first.first_share is None:
        return f"{text}, in one scenario."
    certainty = "certain" if first.first_share >= _CERTAIN else "not certain"
    return f"{text}. That lead is {certainty}: it holds in {percent(first.first_share)} of the draws of scenarios."


def method(scenarios: int) -> str:
    """How the trackers were ranked over so many scenarios."""
    text = (
        "Rank by position RMSE within each scenario, averaged. Won, lost and undecided count the pairings with every "
        "other tracker in every scenario: won where the error is smaller by a difference that is real (paired over "
        "runs, 5 % level after Holm), undecided where no difference was shown. "
    )
    if scenarios < 2:
        return text + "One scenario says nothing of how the order would change in another."
    return text + (
        f"The interval of the mean rank and the share of draws in which a tracker is first come from {RESAMPLES:,} "
        "draws of as many scenarios with replacement: they tell how much the order hangs on the choice of scenarios."
    )


def failures(scenarios: Sequence[ScenarioScores]) -> list[tuple[str, str, str]]:
    """Scenario, tracker and cause of every score that is missing."""
    return [(s.name, name, score.failure) for s in scenarios for name, score in s.scores.items() if score.failure]


def overall(standings: Sequence[Standing]) -> Table:
    """Every tracker's standing, best first."""
    headings = [
        "",
        "tracker",
        "mean rank",
        "95 % interval",
        "first in draws",
        "won",
        "lost",
        "undecided",
        "consistent",
        "diverged runs",
        "scenarios",
    ]
    rows = [
        [
            Cell(str(i)),
            Cell(s.tracker, tracker=s.tracker),
            Cell(fixed(s.mean_rank, 2)),
            Cell(interval(s.ci95, 2) or NOT_AVAILABLE),
            Cell(percent(s.first_share)),
            Cell(str(s.won)),
            Cell(str(s.lost)),
            Cell(str(s.undecided)),
            Cell(f"{s.consistent} of {s.judged}"),
            Cell(str(s.diverged_runs)),
            Cell(str(s.scenarios), (f"({s.failed} without a score)",) if s.failed else ()),
        ]
        for i, s in enumerate(standings, 1)
    ]
    return Table([(heading, "") for heading in headings], rows)


def position_matrix(scenarios: Sequence[ScenarioScores], names: Sequence[str]) -> Table:
    """Position RMSE in m, scenarios down and trackers across."""
    return _matrix(scenarios, names, _rmse)


def nees_matrix(scenarios: Sequence[ScenarioScores], names: Sequence[str]) -> Table:
    """Mean NEES with its verdict, scenarios down and trackers across."""
    return _matrix(scenarios, names, _nees)


def scenario_list(scenarios: Sequence[ScenarioScores]) -> Table:
    """What each scenario is, and whether its expectations were met."""
    rows = [
        [
            Cell(s.name),
            Cell(s.description),
            Cell(str(s.runs)),
            Cell(str(s.seed)),
            Cell(f"{s.expectations_met} of {s.expectations} met" if s.expectations else "none stated"),
        ]
        for s in scenarios
    ]
    return Table([(text, "") for text in ("scenario", "what it shows", "runs", "seed", "expectations")], rows)


def _matrix(scenarios: Sequence[ScenarioScores], names: Sequence[str], cell: Callable[[Score, int], Cell]) -> Table:
    rows = []
    for scenario in scenarios:
        places = decimals([score.position_rmse for score in scenario.scores.values()])
        found = [scenario.scores.get(name) for name in names]
        rows.append([Cell(scenario.name), *(Cell("") if score is None else cell(score, places) for score in found)])
    return Table([("scenario", ""), *((name, "") for name in names)], rows)


def _rmse(score: Score, places: int) -> Cell:
    if score.position_rmse is None:
        return Cell("failed", tone="bad")
    details = []
    if score.ci95:
        details.append(f"±{fixed((score.ci95[1] - score.ci95[0]) / 2, places)}")
    if score.diverged_runs:
        details.append(f"({counted(score.diverged_runs, 'run')} diverged)")
    return Cell(fixed(score.position_rmse, places), tuple(details), strong=score.leading)


def _nees(score: Score, _: int) -> Cell:
    if score.nees is None or score.nees_verdict is None:
        return Cell(NOT_AVAILABLE)
    return Cell(fixed(score.nees, 1), (score.nees_verdict,), TONE[score.nees_verdict])
