"""All trackers over all scenarios: a matrix and an overall ranking, as HTML, Markdown, JSON and figures.

The same for the same results: neither dates nor times of computing are in it, so it can be kept as a reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from trackbench.report.comparison_figures import efficiency_figure, rank_figure
from trackbench.report.comparison_html import to_html
from trackbench.report.comparison_markdown import to_markdown
from trackbench.report.standings import ScenarioScores, Score, Standing, scenario_scores, standings
from trackbench.results import Result

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Comparison:
    """The scores of every scenario and the standing of every tracker, best first."""

    scenarios: tuple[ScenarioScores, ...]
    standings: tuple[Standing, ...]

    def markdown(self) -> str:
        """The comparison as Markdown, which shows the :meth:`figures` beside it."""
        return to_markdown(self.scenarios, self.standings, list(self.figures()))

    def html(self) -> str:
        """The comparison as one HTML file that needs nothing else; it points to the report of each scenario."""
        return to_html(self.scenarios, self.standings)

    def json(self) -> dict[str, Any]:
        """The comparison as JSON values, numbers to four significant digits."""
        return {
            "schema_version": SCHEMA_VERSION,
            "metric": "position_rmse",
            "unit": "m",
            "scenarios": [_scenario(scenario) for scenario in self.scenarios],
            "overall": [_standing(standing) for standing in self.standings],
        }

    def figures(self) -> dict[str, str]:
        """SVG files by their path relative to the Markdown."""
        return {
            "figures/ranks.svg": rank_figure(self.standings).file(),
            "figures/efficiency.svg": efficiency_figure(self.scenarios, self.standings).file(),
        }


def compare(results: Sequence[Result]) -> Comparison:
    """Compare all trackers over all scenarios; trackers of the same name are taken to be the same."""
    scenarios = [scenario_scores(result) for result in results]
    return Comparison(tuple(scenarios), tuple(standings(results, scenarios)))


def _scenario(scenario: ScenarioScores) -> dict[str, Any]:
    return {
        "name": scenario.name,
        "description": scenario.description,
        "runs": scenario.runs,
        "seed": scenario.seed,
        "expectations": scenario.expectations,
        "expectations_met": scenario.expectations_met,
        "trackers": {name: _score(score) for name, score in scenario.scores.items()},
    }


def _score(score: Score) -> dict[str, Any]:
    if score.rank is None:
        return {"position_rmse": None, "reason": score.failure}
    return {
        "position_rmse": _short(score.position_rmse),
        "ci95": _pair(score.ci95),
        "efficiency": _short(score.efficiency),
        "nees": _short(score.nees),
        "nees_verdict": score.nees_verdict,
        "rank": score.rank,
        "leading": score.leading,
        "diverged_runs": score.diverged_runs,
    }


def _standing(standing: Standing) -> dict[str, Any]:
    return {
        "tracker": standing.tracker,
        "scenarios": standing.scenarios,
        "mean_rank": _short(standing.mean_rank),
        "ci95": _pair(standing.ci95),
        "first_share": _short(standing.first_share),
        "won": standing.won,
        "lost": standing.lost,
        "undecided": standing.undecided,
        "consistent_scenarios": standing.consistent,
        "judged_scenarios": standing.judged,
        "diverged_runs": standing.diverged_runs,
        "failed_scenarios": standing.failed,
    }


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def _pair(bounds: tuple[float, float] | None) -> list[float | None] | None:
    return None if bounds is None else [_short(bound) for bound in bounds]
