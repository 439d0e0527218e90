"""The comparison over scenarios as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from trackbench.report.markdown import escape, grid
from trackbench.report.numbers import decimals, fixed, interval, percent
from trackbench.report.standings import RESAMPLES, ScenarioScores, Score, Standing
from trackbench.words import counted

#: Mean ranks with a lead at least this frequent are called certain.
_CERTAIN = 0.95

_ALTERNATIVES = {
    "figures/ranks.svg": "Mean rank of each tracker with its 95 % interval",
    "figures/efficiency.svg": "Position RMSE over the Cramér-Rao bound for each scenario and tracker",
}


def to_markdown(scenarios: Sequence[ScenarioScores], standings: Sequence[Standing], figures: Sequence[str]) -> str:
    """The whole comparison; ``figures`` are paths relative to it."""
    names = [standing.tracker for standing in standings]
    lines = [
        "# Comparison of trackers",
        "",
        f"{counted(len(names), 'tracker')} over {counted(len(scenarios), 'scenario')}. {_lead(standings)}",
        "",
        "## Overall",
        "",
        *_overall(standings),
        "",
        _method(len(scenarios)),
        "",
        *(f"![{_ALTERNATIVES[figure]}]({figure})" for figure in figures[:1]),
        "",
        "## Position RMSE, m",
        "",
        "With half of its 95 % interval. Bold: the best of the scenario, and every tracker from which no difference to "
        "the best was shown (paired over runs, Holm).",
        "",
        *_matrix(scenarios, names, _rmse),
        "",
        *(f"![{_ALTERNATIVES[figure]}]({figure})" for figure in figures[1:]),
        "",
        "## Does each tracker know its own error?",
        "",
        "Mean NEES, which should be 4. Optimistic: errors are larger than the tracker claims; pessimistic: smaller; "
        "undecided: too few runs to say.",
        "",
        *_matrix(scenarios, names, _nees),
        "",
        "## Scenarios",
        "",
        *_scenarios(scenarios),
    ]
    failures = [(s.name, name, score.failure) for s in scenarios for name, score in s.scores.items() if score.failure]
    if failures:
        lines += ["", "## Without a score", ""]
        lines += [f"- {escape(name)} in {escape(where)}: {escape(cause)}" for where, name, cause in failures]
    return "\n".join(lines) + "\n"


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


def _method(scenarios: int) -> str:
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


def _overall(standings: Sequence[Standing]) -> list[str]:
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
            str(i),
            f"**{escape(s.tracker)}**",
            fixed(s.mean_rank, 2),
            interval(s.ci95, 2) or "n/a",
            percent(s.first_share),
            str(s.won),
            str(s.lost),
            str(s.undecided),
            f"{s.consistent} of {s.judged}",
            str(s.diverged_runs),
            str(s.scenarios) + (f" ({s.failed} without a score)" if s.failed else ""),
        ]
        for i, s in enumerate(standings, 1)
    ]
    return grid(headings, rows)


def _matrix(scenarios: Sequence[ScenarioScores], names: Sequence[str], cell: Callable[[Score, int], str]) -> list[str]:
    rows = []
    for scenario in scenarios:
        places = decimals([score.position_rmse for score in scenario.scores.values()])
        found = [scenario.scores.get(name) for name in names]
        rows.append([escape(scenario.name), *("" if score is None else cell(score, places) for score in found)])
    return grid(["scenario", *names], rows, left=1)


def _rmse(score: Score, places: int) -> str:
    if score.position_rmse is None:
        return "failed"
    value = fixed(score.position_rmse, places)
    width = f" ±{fixed((score.ci95[1] - score.ci95[0]) / 2, places)}" if score.ci95 else ""
    lost = f" ({counted(score.diverged_runs, 'run')} diverged)" if score.diverged_runs else ""
    return (f"**{value}**" if score.leading else value) + width + lost


def _nees(score: Score, _: int) -> str:
    if score.nees is None:
        return "n/a"
    return f"{fixed(score.nees, 1)} {score.nees_verdict}"


def _scenarios(scenarios: Sequence[ScenarioScores]) -> list[str]:
    rows = [
        [
            escape(s.name),
            escape(s.description),
            str(s.runs),
            str(s.seed),
            f"{s.expectations_met} of {s.expectations} met" if s.expectations else "none stated",
        ]
        for s in scenarios
    ]
    return grid(["scenario", "what it shows", "runs", "seed", "expectations"], rows)
