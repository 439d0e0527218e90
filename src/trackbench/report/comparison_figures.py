"""The figures of the comparison over scenarios."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from trackbench.palette import TRACKER_COLOURS
from trackbench.report.figures import Picture
from trackbench.report.numbers import fixed
from trackbench.report.standings import ScenarioScores, Standing
from trackbench.report.svg import MUTED, draw, in_page, standalone

_WIDTH = 760
_ROW = 24.0
_MAP = colormaps["Oranges"]
#: Darker cells would make their numbers hard to read.
_DARKEST = 0.55
_ON_LIGHT = "#1c2126"


@dataclass(frozen=True)
class Drawing:
    """A figure that becomes a file of its own or a part of a page."""

    name: str
    title: str
    alternative: str
    paint: Callable[[Figure], None]
    height: float

    def file(self) -> str:
        """The text of an SVG file."""
        return standalone(draw(self.paint, self.height, width=_WIDTH), self.alternative)

    def picture(self, caption: str) -> Picture:
        """The figure of a page."""
        svg = in_page(draw(self.paint, self.height, width=_WIDTH), self.name, self.alternative, {})
        return Picture(self.name, self.title, caption, self.alternative, svg, (), wide=True)


def rank_figure(standings: Sequence[Standing]) -> Drawing:
    """Mean rank of each tracker with its interval."""
    ordered = list(reversed(standings))

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="mean rank over the scenarios, 1 is best")
        for y, standing in enumerate(ordered):
            low, high = standing.ci95 or (standing.mean_rank, standing.mean_rank)
            axes.plot([low, high], [y, y], color=TRACKER_COLOURS[5], linewidth=5, alpha=0.35)
            axes.plot([standing.mean_rank], [y], marker="o", markersize=8, color=TRACKER_COLOURS[5])
        axes.set_yticks(range(len(ordered)), [standing.tracker for standing in ordered])
        axes.set(xlim=(0.8, len(ordered) + 0.2), ylim=(-0.6, len(ordered) - 0.4))
        axes.grid(visible=False, axis="y")

    means = ", ".join(f"{standing.tracker} {fixed(standing.mean_rank, 1)}" for standing in standings)
    alternative = f"Mean rank of each tracker with its 95 % interval: {means}"
    return Drawing("ranks", "Overall ranking", alternative, paint, 50 + _ROW * len(ordered))


def efficiency_figure(scenarios: Sequence[ScenarioScores], standings: Sequence[Standing]) -> Drawing:
    """Position RMSE over the bound, scenarios down and trackers across."""
    names = [standing.tracker for standing in standings]
    values = np.array([[_efficiency(scenario, name) for name in names] for scenario in scenarios])
    worst = float(np.nanmax(values, initial=2.0))

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        for (row, col), value in np.ndenumerate(values):
            if np.isfinite(value):
                shade = _DARKEST * np.log(max(1.0, value)) / np.log(worst)
                axes.add_patch(Rectangle((col - 0.48, row - 0.46), 0.96, 0.92, color=_MAP(shade)))
            text = (
                fixed(float(value), 2) if np.isfinite(value) else "n/a" if names[col] in scenarios[row].scores else ""
            )
            # A filled cell is light on a dark page too.
            ink = _ON_LIGHT if np.isfinite(value) else MUTED
            axes.text(col, row, text, ha="center", va="center", color=ink, fontsize=10)
        axes.set_xticks(range(len(names)), names)
        axes.set_yticks(range(len(scenarios)), [scenario.name for scenario in scenarios])
        axes.set(xlim=(-0.5, len(names) - 0.5), ylim=(len(scenarios) - 0.5, -0.5))
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        axes.grid(visible=False)

    alternative = "Position RMSE over the Cramér-Rao bound for each scenario and tracker; 1 is the best possible"
    return Drawing("efficiency", "Position RMSE over the bound", alternative, paint, 30 + _ROW * len(scenarios))


def _efficiency(scenario: ScenarioScores, name: str) -> float:
    score = scenario.scores.get(name)
    return np.nan if score is None or score.efficiency is None else score.efficiency
