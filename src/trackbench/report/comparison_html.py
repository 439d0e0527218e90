"""The comparison over scenarios as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.report.comparison_figures import efficiency_figure, rank_figure
from trackbench.report.comparison_tables import (
    HONESTY,
    MATRIX,
    failures,
    lead,
    method,
    nees_matrix,
    overall,
    position_matrix,
    scenario_list,
)
from trackbench.report.figures import look_of
from trackbench.report.page import page
from trackbench.report.standings import ScenarioScores, Standing

_RANKS = (
    "Dots are mean ranks, bars their 95 % intervals. Where bars overlap, other scenarios could turn the order round."
)
_EFFICIENCY = (
    "How many times the least error that any tracker of the same sensors could have; darker is worse. Below 1: the "
    "vehicles move more smoothly than the bound assumes."
)


def to_html(scenarios: Sequence[ScenarioScores], standings: Sequence[Standing]) -> str:
    """The text of the file, the same for the same results."""
    names = [standing.tracker for standing in standings]
    return page(
        "comparison.html.j2",
        title="Comparison of trackers",
        looks=look_of(names),
        lead=lead(scenarios, standings),
        method=method(len(scenarios)),
        explained={"matrix": MATRIX, "honesty": HONESTY},
        ranks=rank_figure(standings).picture(_RANKS),
        efficiency=efficiency_figure(scenarios, standings).picture(_EFFICIENCY),
        overall=overall(standings),
        position=position_matrix(scenarios, names),
        nees=nees_matrix(scenarios, names),
        scenarios=scenario_list(scenarios),
        failures=failures(scenarios),
    )
