"""What a scenario states to hold, held against what was found."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.metrics.differences import UNDECIDED, size
from trackbench.metrics.registry import HEALTH
from trackbench.results import Difference, ExpectationResult, TrackerResult
from trackbench.scenario.config import Expectation


def judge(
    expectations: Sequence[Expectation],
    trackers: Sequence[TrackerResult],
    differences: Sequence[Difference],
    min_coverage: float,
) -> list[ExpectationResult]:
    """Each expectation with its value and whether it holds; none holds of a tracker with too few estimates."""
    by_name = {tracker.name: tracker for tracker in trackers}
    return [_judge(item, by_name[item.tracker], differences, min_coverage) for item in expectations]


def _judge(
    item: Expectation, tracker: TrackerResult, differences: Sequence[Difference], min_coverage: float
) -> ExpectationResult:
    value = _value_at_path(tracker, item.metric)
    number = value if isinstance(value, float | int) else None
    note = silent = _silence(tracker, item.metric, min_coverage)
    operator: str
    limit: str | float
    undecided = False
    if item.better_than is not None:
        # The same difference, corrected, as the tables show.
        pair = {item.tracker, item.better_than}
        difference = next(
            (each for each in differences if each.metric == item.metric and {each.a, each.b} == pair), None
        )
        operator, limit = "better_than", item.better_than
        passed = difference is not None and difference.better == item.tracker
        undecided = difference is not None and difference.verdict == UNDECIDED
        if not passed and not note:
            note = _not_better(item.tracker, difference)
    elif item.equals is not None:
        operator, limit, passed, undecided = "is", item.equals, value == item.equals, value == UNDECIDED
    elif item.below is not None:
        operator, limit, passed = "below", item.below, number is not None and number < item.below
    else:
        assert item.above is not None
        operator, limit, passed = "above", item.above, number is not None and number > item.above
    shown = f"{limit:g}" if isinstance(limit, float) else limit
    return ExpectationResult(
        tracker=item.tracker,
        metric=item.metric,
        operator=operator,
        limit=limit,
        value=value,
        passed=passed and not note,
        undecided=undecided and not passed and not silent,
        text=f"{item.tracker} {item.metric} {operator.replace('_', ' ')} {shown}{note}",
    )


def _not_better(tracker: str, difference: Difference | None) -> str:
    """What was shown of the two trackers instead."""
    if difference is None:
        return " (not compared)"
    assert difference.p_value is not None
    value = difference.value if difference.a == tracker else -difference.value
    word = difference.verdict
    if difference.turned:
        word = f"{size(value)}, but not without what is charged for missing estimates"
    untested = difference.ci95 is None and difference.p_value == 1
    tested = "too few runs or scenes to test" if untested else f"{word}, p = {difference.p_value:.2g}"
    return f" (difference {value:+.3g} {difference.unit}, {tested})"


def _silence(tracker: TrackerResult, path: str, min_coverage: float) -> str:
    """The missing estimates or innovations that the metric rests on, where there are too many."""
    for name, what in (("coverage", "estimates"), (path, "innovations"), (path.rpartition(".")[0], "innovations")):
        metric = tracker.metrics.get(name)
        share = None if metric is None else metric.value if name == "coverage" else metric.coverage
        if share is not None and share < min_coverage and path != "coverage":
            return f" ({100 * (1 - share):.0f} % of the {what} are missing)"
    return ""


def _value_at_path(tracker: TrackerResult, path: str) -> float | str | None:
    """The value at a path that an expectation may name; None where there is none."""
    if path.startswith(HEALTH):
        count: float | None = getattr(tracker.health, path.removeprefix(HEALTH))
        return count
    if path in tracker.metrics:
        return tracker.metrics[path].value
    name, _, field = path.rpartition(".")
    value: float | str | None = getattr(tracker.metrics.get(name), field, None)
    return value
