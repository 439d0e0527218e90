"""The report of a run whose detections nobody labelled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from trackbench.document import Block, Cell, Column, Document, Item, Items, Paragraph, Section, Status, Table
from trackbench.document.styles import tracker_styles
from trackbench.palette import tracker_colours
from trackbench.report.run import tables
from trackbench.report.run.cells import INTERVAL, TRACKER, names, values
from trackbench.report.run.document import reproduction, truth_and_sensors
from trackbench.report.run.pairs import Pairs, groups
from trackbench.report.run.scenes import basis_of_intervals
from trackbench.report.run.sentences import expectations_met, facts, failure
from trackbench.report.traffic import without_truth
from trackbench.results import Result
from trackbench.traffic_metrics import METRICS
from trackbench.words import counted

#: The tables: title, and the metrics that are their columns.
GROUPS: dict[str, tuple[str, ...]] = {
    "Ranking": ("gospa", "gospa_localisation", "gospa_missed", "gospa_false", "hota", "idf1", "mota"),
    "Identity": ("tgospa", "gospa_switch", "id_switches", "fragmentations", "assa", "track_purity"),
    "Detection": ("deta", "matched_share", "false_tracks", "confirm_latency", "confirm_latency_95", "lost_time_share"),
    "Errors of matched tracks": ("position_rmse", "velocity_rmse", "nees", "motp", "matched_share"),
    "Association": (
        "association_right", "association_wrong_object", "association_clutter", "association_missed",
    ),
}  # fmt: skip


def traffic_document(result: Result, colours: Mapping[str, str] | None = None) -> Document:
    """The report of a run of trackers of several objects.

    Args:
        result: what was found.
        colours: of every tracker of a batch of scenarios; of those of this one, in its order, unless given.
    """
    summary = result.summary
    styles = tracker_styles(colours or tracker_colours(tracker.name for tracker in summary.trackers))
    sections = [
        Section("Verdict", tuple(_verdict(result))),
        *(_scores(result) if summary.truth.known else without_truth.scores(result)),
        *([Section("Expectations", (tables.expectations(result),))] if summary.expectations else []),
        Section("Truth and sensors", tuple(truth_and_sensors(result))),
        Section("How to reproduce it", tuple(reproduction(result))),
    ]
    shown = tuple(styles[tracker.name] for tracker in result.drawn)
    return Document(
        "report", summary.scenario.name, tuple(sections), summary.scenario.description, facts(result), shown
    )


def _verdict(result: Result) -> Iterator[Block]:
    summary, missing = result.summary, result.unscored
    if not summary.truth.known:
        yield without_truth.statement()
    elif result.scored:
        best = result.scored[0]
        share = best.metrics["matched_share"].value or 0.0
        text = f"{best.name} has the smallest GOSPA, {best.metrics['gospa'].value:.3g} m, and follows "
        yield Paragraph(text + f"{100 * share:.1f} % of what is due.", strong=True)
    yield Status(
        expectations_met(summary.expectations), "" if not summary.expectations else "good" if summary.passed else "bad"
    )
    if missing:
        yield Status(f"{counted(len(missing), 'tracker')} not ranked", "bad")
        failures = tuple(Item(failure(result, tracker), tracker.name, tone="bad") for tracker in missing)
        yield Section("Not ranked", (Items(failures),))


def _scores(result: Result) -> Iterator[Section]:
    trackers = result.scored
    if not trackers:
        return
    group = groups([tracker.name for tracker in trackers], Pairs(result.summary))
    for title, paths in GROUPS.items():
        columns = [(TRACKER, names(trackers))]
        if title == "Ranking":
            columns.append((Column("group", left=True), [Cell(group[tracker.name]) for tracker in trackers]))
        for path in paths:
            metric = METRICS[path]
            heading = f"{path.replace('_', ' ')}{f', {metric.unit}' if metric.unit else ''}"
            columns.append((Column(heading, metric.meaning, details=INTERVAL), values(trackers, path)))
        note = f"Small print is the 95 % interval, {basis_of_intervals(result)}."
        yield Section(title, (Paragraph(note), Table.of_columns(title.lower().replace(" ", "_"), columns)))
