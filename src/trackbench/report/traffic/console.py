"""What a run of unlabelled detections found, for a terminal of 80 columns."""

from __future__ import annotations

from rich.text import Text

from trackbench.report.numbers import decimals, fixed
from trackbench.report.run.cells import metric_of
from trackbench.report.run.scenes import basis_of_intervals
from trackbench.report.traffic.sentences import reused_identities
from trackbench.results import Result

#: The columns: heading, metric, significant digits, and the factor of its unit in the heading.
COLUMNS = (
    ("GOSPA m", "gospa", 3, 1.0),
    ("missed", "gospa_missed", 3, 1.0),
    ("false", "gospa_false", 3, 1.0),
    ("HOTA", "hota", 3, 1.0),
    ("IDF1", "idf1", 3, 1.0),
    ("sw/min", "id_switches", 2, 1.0),
    ("pos. m", "position_rmse", 3, 1.0),
    ("NEES", "nees", 2, 1.0),
    ("matched %", "matched_share", 3, 100.0),
)


#: Without a truth.
COLUMNS_WITHOUT_TRUTH = (
    ("tracks", "track_count", 3, 1.0),
    ("length s", "track_length", 3, 1.0),
    ("new/min", "new_tracks", 3, 1.0),
    ("used %", "used_share", 3, 100.0),
    ("NIS", "nis", 2, 1.0),
    ("breaks", "track_breaks", 2, 1.0),
    ("own br.", "own_track_breaks", 2, 1.0),
    ("swaps", "track_swaps", 2, 1.0),
    ("score", "prediction_score", 3, 1.0),
)


def values(result: Result) -> list[tuple[str, list[Text]]]:
    """Each column's heading and cells."""
    found, trackers = [], result.scored
    for heading, path, digits, factor in COLUMNS if result.summary.truth.known else COLUMNS_WITHOUT_TRUTH:
        numbers = [None if (value := metric_of(t, path).value) is None else factor * value for t in trackers]
        places = decimals(numbers, digits)
        texts = map(_nees, numbers) if path == "nees" else (fixed(number, places) for number in numbers)
        found.append((heading, [Text(text) for text in texts]))
    return found


def _nees(value: float | None) -> str:
    """In four letters at most."""
    if value is not None and value >= 999.5:
        return ">999"
    return fixed(value, 1 if value is None or value < 99.95 else 0)


def notes(result: Result) -> list[str]:
    """What the headings mean."""
    if not result.summary.truth.known:
        return notes_without_truth()
    cutoff = result.summary.score.cutoff_m or 0.0
    any_reference = any(tracker.is_reference for tracker in result.scored)
    return [
        f"missed, false: parts of GOSPA (cutoff {cutoff:g} m); sw/min: switches per object-minute",
        f"pos. m, NEES (4 expected): of tracks within {cutoff / 2:g} m of their object",
        *(["*: a reference, which knows which detection is whose; no competitor"] if any_reference else []),
        "intervals are in the report; they are",
        basis_of_intervals(result),
        *([reused] if (reused := reused_identities(result)) else []),
    ]


def notes_without_truth() -> list[str]:
    """What the headings mean, and what is not told."""
    return [
        "There is no truth: no errors, no GOSPA, no HOTA, and no ranking; trackers stand in the scenario's order.",
        "tracks: mean number; length: median; used: share of detections; NIS: 1 when consistent",
        "breaks: our track ends and the sensor's own goes on; own br.: the other way round;",
        "swaps: both go on in other pairs; each per minute. score: of predicted detections, nats",
    ]
