"""The report of a run whose detections nobody labelled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.document import (
    Block,
    Cell,
    Code,
    Column,
    Document,
    Figure,
    Paragraph,
    Row,
    Section,
    Table,
    TrackerStyle,
)
from trackbench.metrics.track_events import TrackEvent, events_of
from trackbench.metrics.traffic import DETECTION_METRICS, TRACK_METRICS
from trackbench.report.numbers import fixed, margin_words, percent
from trackbench.report.run import tables
from trackbench.report.run.document import differences_section, framed, standings
from trackbench.report.run.figures.map import map_of_tracks
from trackbench.report.run.pairs import letters
from trackbench.report.run.scenes import basis_of_intervals, scenes
from trackbench.report.run.sentences import headline
from trackbench.report.run.tables import INTERVAL, TRACKER, names, values
from trackbench.report.traffic.figures import existence_calibration, gospa_over_time, strip_chart
from trackbench.report.traffic.sentences import association_against_filtering, censored, reused_identities, verdict
from trackbench.results import Result, TrackerResult

#: The tables: title, what to know of it, and the metrics that are its columns.
GROUPS_WITHOUT_TRUTH: dict[str, tuple[str, tuple[str, ...]]] = {
    "Tracks": (
        "Trackers stand in the scenario's order. More or longer tracks are not better: they may be of nothing.",
        ("track_count", "new_tracks", "track_length", "used_share"),
    ),
    "Beside the sensor's own tracks": (
        "The sensor says of which of its own tracks each detection is, which the trackers are not told. It is one more "
        "tracker and no truth: where the two differ, either may be wrong.",
        ("track_breaks", "own_track_breaks", "track_swaps"),
    ),
    "Predictions": (
        "Before each scan a built-in tracker is asked where its tracks are. NIS is of the detections that they "
        "then used, so a tracker that takes only near ones has a small one. The score is of all detections of all "
        "scans: each tracker is asked the same. It tells how well the sensor's next scan is predicted, false alarms "
        "and all, and not how near the tracks are to vehicles; only differences of it mean something.",
        ("nis", "prediction_score"),
    ),
}


def statement_without_truth() -> Paragraph:
    """What a reader must know first."""
    return Paragraph(
        "The recording has no truth. Nothing here tells how large an error is or which tracker is better, and none is "
        "ranked.",
        strong=True,
    )


def sections_without_truth(result: Result) -> Iterator[Section]:
    """What can be told, and what cannot."""
    trackers = result.scored
    for title, (note, paths) in GROUPS_WITHOUT_TRUTH.items():
        columns = [(TRACKER, names(trackers))]
        for path in paths:
            metric = DETECTION_METRICS[path]
            unit = f", {metric.unit}" if metric.unit != "1" else ""
            columns.append((Column(path.replace("_", " ") + unit, metric.meaning), values(trackers, path)))
        table = Table.of_columns(title.lower().replace(" ", "_").replace("'", ""), columns)
        yield Section(title, (Paragraph(note), table))
    missing = ", ".join(path.replace("_", " ") for path in TRACK_METRICS)
    yield Section("What cannot be told", (Paragraph(f"Not without a truth: {missing}."),))


#: Events of each tracker that are listed.
LISTED = 3
#: The most rows of causes.
MOST_CAUSES = 24


class _Cause(NamedTuple):
    tracker: str
    kind: str
    why: str
    times: int
    cost: float
    share: float


def costliest(result: Result) -> dict[str, list[TrackEvent]]:
    """By scored tracker the events of the recorded run that cost most, best tracker first."""
    run = result.summary.recorded_run
    found = {tracker.name: events_of(result, tracker.name, run)[:LISTED] for tracker in result.scored}
    return {name: events for name, events in found.items() if events}


def events_section(result: Result) -> Iterator[Section]:
    """The costliest events of the recorded run with the commands that show them, and what all runs' events cost."""
    found = costliest(result)
    if not found:
        return
    run = result.summary.recorded_run
    blocks: list[Block] = [
        Paragraph(
            "The cost of an event is the squared GOSPA of the missed objects and false tracks until it ends, or of the "
            "switch in squared T-GOSPA. In the folder of this run, trackbench inspect . --worst 10 lists more, and "
            "these commands open the recording at the first event of each tracker:"
        ),
        Code("\n".join(_command(name, events[0]) for name, events in list(found.items())[:LISTED]), "sh"),
        _event_table(found),
        *([causes] if (causes := _causes(result)) else []),
    ]
    yield Section(f"Costliest events of run {run}", tuple(blocks))


def _command(tracker: str, event: TrackEvent) -> str:
    return f"trackbench view . --worst --tracker {tracker}  # {event.kind} at {event.time_s:.2f} s"


def _event_table(found: dict[str, list[TrackEvent]]) -> Table:
    rows = [(name, event) for name, events in found.items() for event in events]
    columns = [
        (TRACKER, [Cell(name, tracker=name) for name, _ in rows]),
        (Column("event", left=True), [Cell(event.kind) for _, event in rows]),
        (Column("time, s"), [Cell(fixed(event.time_s, 2)) for _, event in rows]),
        (Column("vehicle", left=True), [Cell(event.object or "none") for _, event in rows]),
        (Column("track"), [Cell("none" if event.track is None else str(event.track)) for _, event in rows]),
        (Column("cost, m²"), [Cell(fixed(event.cost_m2, 1)) for _, event in rows]),
        (Column("why", left=True), [Cell(event.reason) for _, event in rows]),
    ]
    return Table.of_columns("costliest-events", columns)


def _causes(result: Result) -> Table | None:
    """What the missed objects, false tracks and switches of each tracker come from."""
    found: list[_Cause] = []
    for tracker in result.drawn:
        events = [event for event in events_of(result, tracker.name) if event.cost_m2 > 0]
        total = sum(event.cost_m2 for event in events)
        for kind, why in dict.fromkeys((event.kind, event.cause) for event in events):
            costs = [event.cost_m2 for event in events if (event.kind, event.cause) == (kind, why)]
            found.append(_Cause(tracker.name, kind, why, len(costs), float(np.sum(costs)), sum(costs) / total))
    if not found:
        return None
    order = {tracker.name: rank for rank, tracker in enumerate(result.drawn)}
    found.sort(key=lambda cause: (order[cause.tracker], -cause.cost))
    first = {name: [cause for cause in found if cause.tracker == name] for name in order}
    each = max(1, MOST_CAUSES // max(1, len(first)))
    shown = [cause for causes in first.values() for cause in causes[:each]]
    columns = [
        (TRACKER, [Cell(cause.tracker, tracker=cause.tracker) for cause in shown]),
        (Column("event", left=True), [Cell(cause.kind) for cause in shown]),
        (Column("why", left=True), [Cell(cause.why) for cause in shown]),
        (Column("times", "in all runs"), [Cell(str(cause.times)) for cause in shown]),
        (
            Column("share of the cost", "of all events of the tracker, in all runs"),
            [Cell(percent(cause.share)) for cause in shown],
        ),
    ]
    return Table.of_columns("causes", columns, "What missed objects, false tracks and switches come from, in all runs")


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
        return framed(result, colours, statement_without_truth(), (), lambda *_: sections_without_truth(result))

    def sections(styles: Mapping[str, TrackerStyle], shown: Sequence[TrackerStyle]) -> Iterator[Section]:
        if result.scored:
            yield Section("Ranking", (_note_on_ranking(result), ranking(result)))
        yield from differences_section(result, styles)
        if result.summary.truth.scenes:
            yield Section("Scene by scene", tuple(scenes(result)))
        yield from _objects(result, shown)
        yield from events_section(result)
        yield from _details(result)

    oracles = map(Paragraph, association_against_filtering(result))
    return framed(
        result,
        colours,
        Paragraph(headline(result), strong=True),
        (*oracles, *standings(result, verdict, about)),
        sections,
    )


def _note_on_ranking(result: Result) -> Paragraph:
    margin = margin_words(result.summary.score.margin, "m")
    reference = " A reference knows which detection is whose: it is no competitor."
    return Paragraph(
        f"Small print is the 95 % interval, {basis_of_intervals(result)}. No difference of GOSPA over {margin} was "
        "shown between trackers that share a letter under “group”."
        + (reference if any(tracker.is_reference for tracker in result.scored) else "")
    )


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
