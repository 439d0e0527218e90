"""Results in the order of time: where a change is first shown, what else changed, and a figure of each metric."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.compare import Comparison, PairDifference
from trackbench.compare.comparison import SetOrigin
from trackbench.document import Block, Figure, Item, Items, LegendEntry, Section, end_of_axis
from trackbench.document.drawing import INK
from trackbench.document.palette import Styles, tracker_figure
from trackbench.metrics.differences import EQUIVALENT, UNDECIDED
from trackbench.report.comparison.sentences import entrant_name, set_letter
from trackbench.report.numbers import joined_names
from trackbench.report.tables import unit_after_heading
from trackbench.results import MetricValue

_HEIGHT = 260.0
#: Horizontal distance between the points of two trackers, as a share of the distance between two results.
_APART = 0.06


def is_over_time(comparison: Comparison) -> bool:
    """Return whether the comparison is of one scenario with at least three results, to be drawn over time."""
    return len(comparison.sets) > 2 and len(comparison.scenarios) == 1


def first_shown(items: Sequence[PairDifference]) -> list[PairDifference]:
    """Return the difference of the first result in which each significant change from the baseline appears.

    A change lasts until the tracker is equivalent to the baseline again; an undecided result does not end the change.
    The order is that of the results.
    """
    marks, verdicts = [], dict[str, str]()
    for item in sorted(items, key=lambda item: item.entrant.set):
        if item.verdict not in (UNDECIDED, EQUIVALENT, verdicts.get(item.entrant.tracker)):
            marks.append(item)
        if item.verdict != UNDECIDED:
            verdicts[item.entrant.tracker] = item.verdict
    return marks


def first_shown_in_words(comparison: Comparison, items: Sequence[PairDifference]) -> str:
    """Return a sentence per change: the first result that shows it (at the 5 % level), and what else changed then."""
    sentences = []
    for item in first_shown(items):
        changes = "; ".join(comparison.origins[item.entrant.set].changes)
        beside = f", where also changed: {changes}" if changes else ""
        sentences.append(f"First shown {item.verdict}: {entrant_name(comparison, item.entrant)}{beside}.")
    return " ".join(sentences)


def course_figure(comparison: Comparison, metric: str, items: Sequence[PairDifference], styles: Styles) -> Figure:
    """Return a figure of each tracker's values and intervals in the results; rings mark significant changes."""
    names = [name for name in styles if name in {item.entrant.tracker for item in items}]
    path = metric.removesuffix(".mean")
    values = {(s.entrant.tracker, s.entrant.set): s.metrics[path] for s in comparison.scores if path in s.metrics}
    by_name = {
        name: [values.get((name, number), MetricValue(unit="1")) for number in range(len(comparison.sets))]
        for name in names
    }
    rings = {name: [mark.entrant.set for mark in first_shown(items) if mark.entrant.tracker == name] for name in names}
    highest = {name: max((item.value or 0.0 for item in metrics), default=0.0) for name, metrics in by_name.items()}
    is_positive = all((item.value or 0.0) >= 0.0 for metrics in by_name.values() for item in metrics)
    top = 1.25 * end_of_axis(highest.values()) if is_positive else 0.0
    cut = [name for name, value in highest.items() if value > top > 0.0]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="result", ylabel=f"{metric}{unit_after_heading(items[0].unit)}")
        for number, (name, metrics) in enumerate(by_name.items()):
            places = np.arange(len(metrics)) + _APART * (number - (len(names) - 1) / 2)
            value = np.array([np.nan if item.value is None else item.value for item in metrics])
            low, high = np.array([item.ci95 or (np.nan, np.nan) for item in metrics]).T
            style = styles[name]
            axes.plot(places, value, linestyle=style.line, marker="o", markersize=3, color=style.colour, gid=style.key)
            axes.vlines(places, low, high, linewidth=1.2, alpha=0.6, color=style.colour, gid=style.key)
            axes.plot(places[rings[name]], value[rings[name]], "o", color=INK, markersize=9, markerfacecolor="none")
        if top > 0.0:
            axes.set_ylim(0.0, top)
        axes.set_xticks(range(len(comparison.sets)), [set_letter(number) for number in range(len(comparison.sets))])

    return tracker_figure(
        f"over-time-{metric.replace('.', '-')}",
        f"{metric} over the results",
        "Bars: 95 % intervals."
        + " Rings: where a difference from the first result is first shown." * any(rings.values())
        + (f" Cut off above: {joined_names(cut)}." if cut else ""),
        f"{metric} of each tracker over the results",
        paint,
        _HEIGHT,
        [styles[name] for name in names],
        *([LegendEntry("change first shown", INK, "ring")] if any(rings.values()) else []),
    )


def origin_blocks(comparison: Comparison) -> Iterator[Block]:
    """Yield a section with date and commit of each set of results, and other changes since the previous set."""
    if comparison.origins:
        items = [Item(_origin(origin), label=set_letter(origin.set)) for origin in comparison.origins]
        yield Section("When they were made, and what else changed", (Items(tuple(items)),))


def _origin(origin: SetOrigin) -> str:
    made_at = f"{origin.made_at[:16].replace('T', ' ')} UTC" if origin.made_at else "not known when"
    commit = f", commit {origin.commit}" if origin.commit else ""
    changes = "; ".join(origin.changes) or "nothing else that the results record"
    return f"{made_at}{commit}" + (f": {changes}" if origin.set else "")
