"""All that a result says of its trackers as one tidy table: a row for each tracker, metric, scene and condition."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from trackbench.results.metric_value import Json, MetricValue
from trackbench.results.tracker_result import ConditionScores, TrackerResult

if TYPE_CHECKING:
    from trackbench.results.result import Result

#: The columns: ``condition`` is empty over all estimates, else such as "manoeuvre: braking"; ``n`` counts the runs, of
#: a condition the errors; ``reason`` says why there is no value or no interval.
COLUMNS = ("scenario", "scene", "tracker", "metric", "condition", "value", "low", "high", "n", "unit", "reason")


def tidy(result: Result) -> Any:
    """Return a pandas data frame with the columns ``COLUMNS``; an empty ``scene`` stands for all scenes together."""
    # Takes its time to import.
    import pandas

    scenario, summary = result.name, result.summary
    rows: list[Json] = []
    for tracker in summary.trackers:
        keys = {"scenario": scenario, "tracker": tracker.name}
        rows += [{**keys, "scene": "", **row} for row in _of_tracker(tracker, summary.runs)]
        for scene in summary.truth.scenes:
            if tracker.name in scene.error:
                value = MetricValue(value=scene.error[tracker.name], unit="m")
                runs = summary.runs // len(summary.truth.scenes)
                rows.append({**keys, "scene": scene.name, **_row(summary.headline, "", value, runs)})
    return pandas.DataFrame(rows, columns=list(COLUMNS))


def _of_tracker(tracker: TrackerResult, runs: int) -> Iterator[Json]:
    for path, value in tracker.metrics.items():
        yield _row(path, "", value, runs)
    if tracker.breakdown is None:
        return
    for group in ("manoeuvre", "range", "age", "jump"):
        scores: dict[str, ConditionScores] = getattr(tracker.breakdown, group)
        for name, own in scores.items():
            for path, field in own:
                if isinstance(field, MetricValue):
                    yield _row(path, f"{group}: {name}", field, own.count)


def _row(path: str, condition: str, value: MetricValue, number: int) -> Json:
    low, high = value.ci95 or (None, None)
    named = {"metric": path, "condition": condition, "value": value.value, "low": low, "high": high}
    return {**named, "n": number, "unit": value.unit, "reason": value.reason}
