"""What a scenario states to hold, held against what was found."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.metrics.differences import size
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
    value = value_at(tracker, item.metric)
    operator, limit, passed = _verdict(item, value, differences)
    shown = f"{limit:g}" if isinstance(limit, float) else limit
    note = _silence(tracker, item.metric, min_coverage)
    if item.better_than is not None and not passed and not note:
        note = _not_better(item, differences)
    return ExpectationResult(
        tracker=item.tracker,
        metric=item.metric,
        operator=operator,
        limit=limit,
        value=value,
        passed=passed and not note,
        text=f"{item.tracker} {item.metric} {operator.replace('_', ' ')} {shown}{note}",
    )


def _not_better(item: Expectation, differences: Sequence[Difference]) -> str:
    """What was shown of the two instead."""
    for found in differences:
        if found.metric == item.metric and {found.a, found.b} == {item.tracker, item.better_than}:
            difference = found.value if found.a == item.tracker else -found.value
            word, fewer = found.verdict, found.fewer_estimates
            if fewer is not None:
                word = f"{size(difference)}, but {fewer.tracker} gave {100 * fewer.share:.0f} % fewer estimates"
            return f" (difference {difference:+.3g} {found.unit}, {word}, p = {found.p_value:.2g})"
    return " (not compared)"


def _silence(tracker: TrackerResult, path: str, min_coverage: float) -> str:
    """What is missing of the tracker's answers that the metric rests on, where it is too much."""
    for metric, what in (("coverage", "estimates"), (path, "innovations"), (path.rpartition(".")[0], "innovations")):
        found = tracker.metrics.get(metric)
        share = None if found is None else found.value if metric == "coverage" else found.coverage
        if share is not None and share < min_coverage and path != "coverage":
            return f" ({100 * (1 - share):.0f} % of the {what} are missing)"
    return ""


def _verdict(
    item: Expectation, value: float | str | None, differences: Sequence[Difference]
) -> tuple[str, str | float, bool]:
    """The operator, its limit and whether the value meets it."""
    if item.better_than is not None:
        return "better_than", item.better_than, _better(item, differences)
    if item.equals is not None:
        return "is", item.equals, value == item.equals
    number = value if isinstance(value, float | int) else None
    if item.below is not None:
        return "below", item.below, number is not None and number < item.below
    assert item.above is not None
    return "above", item.above, number is not None and number > item.above


def value_at(tracker: TrackerResult, path: str) -> float | str | None:
    """The value at a path that an expectation may name; None where there is none."""
    if path.startswith(HEALTH):
        found: float | None = getattr(tracker.health, path.removeprefix(HEALTH))
        return found
    if path in tracker.metrics:
        return tracker.metrics[path].value
    name, _, field = path.rpartition(".")
    value: float | str | None = getattr(tracker.metrics.get(name), field, None)
    return value


def _better(item: Expectation, differences: Sequence[Difference]) -> bool:
    """Whether the tracker is shown to be better: by the same difference, corrected, as the tables show."""
    pair = {item.tracker, item.better_than}
    return any(
        found.better == item.tracker
        for found in differences
        if found.metric == item.metric and {found.a, found.b} == pair
    )
