"""What a report says of a recording of detections that has no truth."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.document import Column, Paragraph, Section, Table
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.metrics.traffic.without_truth import DETECTION_METRICS
from trackbench.report.run.cells import TRACKER, names, values
from trackbench.results import Result

#: The tables: title, what to know of it, and the metrics that are its columns.
GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
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


def statement() -> Paragraph:
    """What a reader must know first."""
    return Paragraph(
        "The recording has no truth. Nothing here tells how large an error is or which tracker is better, and none is "
        "ranked.",
        strong=True,
    )


def sections(result: Result) -> Iterator[Section]:
    """What can be told, and what cannot."""
    trackers = result.scored
    for title, (note, paths) in GROUPS.items():
        columns = [(TRACKER, names(trackers))]
        for path in paths:
            metric = DETECTION_METRICS[path]
            unit = f", {metric.unit}" if metric.unit != "1" else ""
            columns.append((Column(path.replace("_", " ") + unit, metric.meaning), values(trackers, path)))
        table = Table.of_columns(title.lower().replace(" ", "_").replace("'", ""), columns)
        yield Section(title, (Paragraph(note), table))
    missing = ", ".join(path.replace("_", " ") for path in TRACK_METRICS)
    yield Section("What cannot be told", (Paragraph(f"Not without a truth: {missing}."),))
