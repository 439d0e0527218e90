"""The comparison over scenarios as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

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
from trackbench.report.markdown import escape, grid
from trackbench.report.standings import ScenarioScores, Standing
from trackbench.report.tables import Cell, Table

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
        lead(scenarios, standings),
        "",
        "## Overall",
        "",
        *_grid(overall(standings)),
        "",
        method(len(scenarios)),
        "",
        *(f"![{_ALTERNATIVES[figure]}]({figure})" for figure in figures[:1]),
        "",
        "## Position RMSE, m",
        "",
        MATRIX,
        "",
        *_grid(position_matrix(scenarios, names), left=1),
        "",
        *(f"![{_ALTERNATIVES[figure]}]({figure})" for figure in figures[1:]),
        "",
        "## Does each tracker know its own error?",
        "",
        HONESTY,
        "",
        *_grid(nees_matrix(scenarios, names), left=1),
        "",
        "## Scenarios",
        "",
        *_grid(scenario_list(scenarios)),
    ]
    found = failures(scenarios)
    if found:
        lines += ["", "## Without a score", ""]
        lines += [f"- {escape(name)} in {escape(where)}: {escape(cause)}" for where, name, cause in found]
    return "\n".join(lines) + "\n"


def _grid(found: Table, left: int = 2) -> list[str]:
    rows = ([_cell(cell) for cell in row] for row in found.rows)
    return grid([heading for heading, _ in found.headings], rows, left)


def _cell(cell: Cell) -> str:
    text = escape(cell.text)
    return " ".join([f"**{text}**" if cell.strong or cell.tracker else text, *map(escape, cell.details)])
