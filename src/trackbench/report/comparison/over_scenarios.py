"""Differences from the baseline over scenarios: a table with a pooled line, and a sentence on the leading tracker."""

from __future__ import annotations

from trackbench.base.errors import counted
from trackbench.compare import Comparison, Entrant, PairDifference
from trackbench.compare.differences import differences_to
from trackbench.document import Cell, Column, Table, Tone
from trackbench.report.comparison.figures import competitors, ranked_label
from trackbench.report.comparison.sentences import NAMES, entrant_name
from trackbench.report.numbers import NOT_AVAILABLE, decimals, half_width, reach_text, rounded, signed
from trackbench.report.pairs import difference_word
from trackbench.report.verdicts import COMPARED

TONES: dict[str, Tone] = {"better": "good", "worse": "bad"}


def scenario_table(comparison: Comparison, metric: str) -> Table:
    """Return the differences of a metric from the baseline, %, by scenario and pooled over all scenarios.

    Rows are the scenarios, or the trackers if there are more trackers than scenarios.
    """
    changes = [change for change in comparison.overall if change.metric == metric]
    of_metric = [item for item in comparison.differences if item.metric == metric]
    shown = differences_to(comparison.baseline, of_metric) if comparison.baseline else of_metric
    items = {(item.entrant, item.scenario): item for item in shown}
    names, over = [scenario.name for scenario in comparison.scenarios], f"all {len(comparison.scenarios)}"
    pooled = [_cell(change.mean_percent, change.ci95) for change in changes]
    columns = {name: [_difference_cell(items.get((change.entrant, name))) for change in changes] for name in names}
    labels = [_label(comparison, change.entrant) for change in changes]
    caption = COMPARED["pooled"].format(over=over)
    table = f"differences-over-scenarios-{metric.replace('.', '-')}"
    if len(changes) > len(names):
        trackers = [Cell(label, tracker=change.entrant.tracker) for label, change in zip(labels, changes, strict=True)]
        return Table.of_columns(
            table,
            [
                (Column("tracker", left=True), trackers),
                (Column(over, details="verdict"), pooled),
                *((Column(name, details="verdict"), cells) for name, cells in columns.items()),
            ],
            caption,
        )
    rows = [(Cell(name), *cells) for name, cells in columns.items()]
    heads = (Column("scenario", left=True), *(Column(label, details="verdict") for label in labels))
    return Table(table, heads, (*rows, (Cell(over, strong=True), *pooled)), caption)


def _label(comparison: Comparison, entrant: Entrant) -> str:
    reference = next((x for x in comparison.ranking if x.tracker == entrant.tracker and x.reference), None)
    return ranked_label(reference) if reference else entrant_name(comparison, entrant)


def _difference_cell(item: PairDifference | None) -> Cell:
    """Return a cell with difference and interval, %, verdict, and in how many scenes the tracker is better."""
    if item is None:
        return Cell("")
    if item.identical:
        return Cell("0", ("identical",))
    ahead = item.scenes_ahead
    scenes = (f"better in {ahead[0]} of {ahead[1]}",) if ahead else ()
    return _cell(item.percent, item.ratio_ci95, (difference_word(item.verdict), *scenes), TONES.get(item.verdict, ""))


def _cell(
    percent: float | None, ci95: tuple[float, float] | None, details: tuple[str, ...] = (), tone: Tone = ""
) -> Cell:
    if percent is None:
        return Cell(NOT_AVAILABLE, details)
    places = change_decimals(percent, ci95)
    reach = reach_text(percent, ci95, places) if (half_width(ci95) or 0.0) >= 0.005 else ""
    beside = f" {reach}" if reach.startswith("±") else f" ({reach})" * bool(reach)
    return Cell(signed(percent, places) + beside, details, tone)


def change_decimals(percent: float, ci95: tuple[float, float] | None) -> int:
    """Return how many decimals show a change, %, up to the first digit of its interval's half width."""
    half = half_width(ci95)
    return min(2, decimals([half], 1)) if half else int(abs(percent) < 10)


def who_is_ahead(comparison: Comparison) -> str:
    """Return a sentence on the leading tracker and its lead in pooled error over the next or over the baseline.

    No tracker is said to be ahead where the interval of the pooled difference includes 0.
    """
    first, second = competitors(comparison)[:2]
    best, over = first.tracker, counted(len(comparison.scenarios), "scenario")
    other = second.tracker if comparison.baseline == best else comparison.baseline
    behind = best if other == comparison.baseline else other
    changes = [item for item in comparison.overall if item.metric == comparison.ranked_by]
    change = next((item for item in changes if item.entrant.tracker == behind), None)
    if change is None or change.mean_percent is None:
        return COMPARED["not known who"].format(over=over, best=best, other=other)
    what, words = NAMES[comparison.ranked_by], _change_in_words(change.mean_percent, change.ci95)
    low, high = change.ci95 or (change.mean_percent, change.mean_percent)
    if low <= 0 <= high:
        than = change.against.tracker
        return COMPARED["nobody ahead"].format(over=over, what=what, subject=behind, than=than, change=words)
    kind = "ahead of baseline" if other == comparison.baseline else "ahead of next"
    text = COMPARED[kind].format(best=best, over=over, what=what, other=other, change=words)
    return text if change.ci95 else f"{text} {COMPARED['not known how sure']}"


def _change_in_words(percent: float, ci95: tuple[float, float] | None) -> str:
    """Return a change with its interval as text: "1.4 % larger (95 %: 0.5 to 2.3 %)"; "the same" for 0."""
    if percent == 0:
        return "the same"
    sign, word = (1, "larger") if percent > 0 else (-1, "smaller")
    places = change_decimals(percent, ci95)
    text = f"{rounded(sign * percent, places)} % {word}"
    if ci95 is None:
        return text
    low, high = sorted(sign * end for end in ci95)
    return f"{text} (95 %: {rounded(low, places)} to {rounded(high, places)} %)"
