"""What a run of unlabelled detections found, for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from trackbench.report.numbers import decimals, fixed
from trackbench.report.run.cells import metric_of
from trackbench.report.run.scenes import basis_of_intervals
from trackbench.results import Result, TrackerResult

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


def values(trackers: Sequence[TrackerResult]) -> list[tuple[str, list[Text]]]:
    """Each column's heading and cells."""
    found = []
    for heading, path, digits, factor in COLUMNS:
        numbers = [None if (value := metric_of(t, path).value) is None else factor * value for t in trackers]
        places = decimals(numbers, digits)
        found.append((heading, [Text(fixed(number, places)) for number in numbers]))
    return found


def notes(result: Result) -> list[str]:
    """What the headings mean."""
    cutoff = result.summary.score.cutoff_m
    return [
        f"missed, false: parts of GOSPA (cutoff {cutoff:g} m); sw/min: switches a minute of an object",
        "pos. m, NEES (4 expected): of matched tracks alone",
        f"intervals are in the report, {basis_of_intervals(result)}",
    ]
