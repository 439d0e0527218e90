"""What a scenario states to hold, held against what was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trackbench.metrics.intervals import Interval, paired
from trackbench.scenario.config import Expectation

Json = dict[str, Any]

#: Paths that begin so are found beside the metrics.
HEALTH = "health."


def judge(
    expectations: Sequence[Expectation],
    trackers: Mapping[str, Json],
    intervals: Mapping[str, Mapping[str, Interval]],
) -> list[Json]:
    """Each expectation with its value and whether it holds.

    Args:
        expectations: as the scenario states them.
        trackers: the entries of the result, by name.
        intervals: the errors of each tracker that did not fail, for paired comparisons.
    """
    return [_judge(item, trackers[item.tracker], intervals) for item in expectations]


def _judge(item: Expectation, entry: Json, intervals: Mapping[str, Mapping[str, Interval]]) -> Json:
    value = _find(entry, item.metric)
    judged: Json = {"tracker": item.tracker, "metric": item.metric}
    operator, limit, passed = _verdict(item, value, intervals)
    words = operator.replace("_", " ")
    shown = f"{limit:g}" if isinstance(limit, float) else limit
    return {
        **judged,
        "operator": operator,
        "limit": limit,
        "value": value,
        "passed": passed,
        "text": f"{item.tracker} {item.metric} {words} {shown}",
    }


def _verdict(
    item: Expectation, value: Any, intervals: Mapping[str, Mapping[str, Interval]]
) -> tuple[str, str | float, bool]:
    """The operator, its limit and whether the value meets it."""
    if item.better_than is not None:
        return "better_than", item.better_than, _better(item, intervals)
    if item.equals is not None:
        return "is", item.equals, value == item.equals
    if item.below is not None:
        return "below", item.below, value is not None and value < item.below
    assert item.above is not None
    return "above", item.above, value is not None and value > item.above


def _find(entry: Json, path: str) -> Any:
    """The value at a dotted path of the metrics, or with a leading ``health.`` of the health."""
    node: Any = entry["health"] if path.startswith(HEALTH) else entry["metrics"]
    for part in path.removeprefix(HEALTH).split("."):
        if not isinstance(node, dict):
            return None
        node = node.get(part)
    return node.get("value", node.get("mean")) if isinstance(node, dict) else node


def _better(item: Expectation, intervals: Mapping[str, Mapping[str, Interval]]) -> bool:
    """Whether the error is smaller by more than chance explains (95 %, paired over the runs)."""
    assert item.better_than is not None
    own, other = (intervals.get(name, {}).get(item.metric) for name in (item.tracker, item.better_than))
    if own is None or other is None:
        return False
    difference = paired(own, other)
    return difference.value < 0.0 and difference.p_value < 0.05
