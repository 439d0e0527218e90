"""The report of a run whose detections nobody labelled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from trackbench.document import (
    Block,
    Cell,
    Column,
    Document,
    Figure,
    Item,
    Items,
    Paragraph,
    Row,
    Section,
    Table,
    TrackerStyle,
)
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.report.numbers import margin_words
from trackbench.report.run import tables
from trackbench.report.run.cells import INTERVAL, TRACKER, names, values
from trackbench.report.run.document import DIFFERENCES
from trackbench.report.run.figures.cost import cost_against_accuracy
from trackbench.report.run.frame import framed
from trackbench.report.run.pairs import letters
from trackbench.report.run.scenes import basis_of_intervals, scenes
from trackbench.report.run.sentences import headline
from trackbench.report.traffic import without_truth
from trackbench.report.traffic.events import events_section
from trackbench.report.traffic.figures import existence_calibration, gospa_over_time
from trackbench.report.traffic.map import map_of_tracks
from trackbench.report.traffic.sentences import association_against_filtering, censored, reused_identities, verdict
from trackbench.report.traffic.strips import strip_chart
from trackbench.results import Result, TrackerResult

RANKING = ("gospa", "gospa_localisation", "gospa_missed", "gospa_false", "hota", "idf1", "mota")
#: The other tables: title, and the metrics that are their columns.
GROUPS: dict[str, tuple[str, ...]] = {
    "Identity": ("tgospa", "gospa_switch", "id_switches", "fragmentations", "assa", "track_purity"),
    "Detection": ("deta", "matched_share", "false_tracks", "confirm_latency", "never_confirmed", "lost_time_share"),
    "Errors of matched tracks": ("position_rmse", "velocity_rmse", "nees", "nees_inside", "motp", "matched_share"),
    "Association": (
        "association_right", "association_wrong_object", "association_clutter", "association_missed",
    ),
}  # fmt: skip

SAME_ID = "Tracks of one identity are scored as one track: a second track of it on the same object is no switch."
#: Words of the metrics' names that are written otherwise.
ACRONYMS = {
    "gospa": "GOSPA", "tgospa": "T-GOSPA", "hota": "HOTA", "deta": "DetA", "assa": "AssA", "idf1": "IDF1",
    "mota": "MOTA", "motp": "MOTP", "rmse": "RMSE", "nees": "NEES",
}  # fmt: skip


def traffic_document(result: Result, colours: Mapping[str, str] | None = None) -> Document:
    """The report of a run of trackers of several objects.

    Args:
        result: what was found.
        colours: of every tracker of a batch of scenarios; of those of this one, in its order, unless given.
    """
    if not result.summary.truth.known:
        return framed(result, colours, without_truth.statement(), (), lambda *_: without_truth.sections(result))
    return framed(
        result, colours, Paragraph(headline(result), strong=True), _standings(result), partial(_of_truth, result)
    )


def _standings(result: Result) -> Iterator[Block]:
    for sentence in association_against_filtering(result):
        yield Paragraph(sentence)
    if result.scored:
        items = [Item(f"{verdict(t)}.", t.name, about(t), t.name) for t in result.contenders]
        yield Items(tuple(items), numbered=True)
        beside = [t for t in result.scored if t not in result.contenders]
        if beside:
            yield Items(tuple(Item(f"{verdict(t)}.", f"{t.name} (reference)", about(t), t.name) for t in beside))


def _of_truth(result: Result, styles: Mapping[str, TrackerStyle], shown: Sequence[TrackerStyle]) -> Iterator[Section]:
    """What only the truth tells."""
    yield from _scores(result, styles)
    if result.summary.truth.scenes:
        yield Section("Scene by scene", tuple(scenes(result)))
    yield from _objects(result, shown)
    yield from events_section(result)
    yield from _details(result)


def _scores(result: Result, styles: Mapping[str, TrackerStyle]) -> Iterator[Section]:
    trackers = result.scored
    if not trackers:
        return
    margin = margin_words(result.summary.score.margin, "m")
    said = f"Small print is the 95 % interval, {basis_of_intervals(result)}. No difference of GOSPA over {margin} was "
    said += "shown between trackers that share a letter under “group”."
    if any(tracker.is_reference for tracker in trackers):
        said += " A reference knows which detection is whose: it is no competitor."
    note = Paragraph(said)
    yield Section("Ranking", (note, ranking(result)))
    if len(trackers) > 1:
        cost = cost_against_accuracy(result.drawn, styles, "gospa")
        beside = Row((tables.key_differences(result), *([cost] if cost else [])))
        pairs = Section("All pairs", (tables.all_differences(result, result.drawn),), folded=True)
        text = DIFFERENCES.format(metric="GOSPA", margin=margin)
        yield Section("Differences between trackers", (Paragraph(text), beside, pairs))


def ranking(result: Result) -> Table:
    """Every scored tracker, best first, with the letters of those that were not shown to differ."""
    trackers = result.scored
    return _table("Ranking", trackers, RANKING, [(Column("group", left=True), list(map(Cell, letters(result))))])


def _table(
    title: str,
    trackers: Sequence[TrackerResult],
    paths: Sequence[str],
    first: Sequence[tuple[Column, list[Cell]]] = (),
) -> Table:
    columns = [(TRACKER, names(trackers)), *first]
    for path in paths:
        metric = TRACK_METRICS[path]
        heading = f"{_named(path)}{f', {metric.unit}' if metric.unit != '1' else ''}"
        columns.append((Column(heading, metric.meaning, details=INTERVAL), values(trackers, path)))
    return Table.of_columns(title.lower().replace(" ", "-"), columns)


def _objects(result: Result, shown: Sequence[TrackerStyle]) -> Iterator[Section]:
    made = result.tables
    figures: list[Figure | None] = [
        gospa_over_time(made.steps, shown),
        strip_chart(made.objects, shown, result.summary.recorded_run),
        map_of_tracks(result, shown),
        existence_calibration(made.existence, shown),
    ]
    drawn = tuple(figure for figure in figures if figure)
    if drawn:
        yield Section("What happened", (Row(drawn),))


def _named(path: str) -> str:
    """A metric as a heading."""
    return " ".join(ACRONYMS.get(word, word) for word in path.split("_"))


def _details(result: Result) -> Iterator[Section]:
    notes = {"Errors of matched tracks": (Paragraph(censored(result)),)}
    if reused := reused_identities(result):
        notes["Identity"] = (Paragraph(f"{reused[0].upper()}{reused[1:]}. {SAME_ID}"),)
    for title, paths in GROUPS.items() if result.scored else ():
        yield Section(title, (_table(title, result.scored, paths), *notes.get(title, ())))
    if (others := tables.other_metrics(result, {*TRACK_METRICS, "step_time"})) is not None:
        yield Section("Other metrics", (others,))


def about(tracker: TrackerResult) -> str:
    """A tracker in a few words."""
    return ", ".join(part for part in (tracker.association, tracker.describe) if part)
