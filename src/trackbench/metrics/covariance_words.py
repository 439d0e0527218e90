"""Verdicts on a covariance in plain words: about right, too small, much too large, outliers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from trackbench.metrics.consistency import DIRECTIONS
from trackbench.metrics.verdicts import HALVES, MEANING, mean_verdict, meaning
from trackbench.results import ConditionScores, MetricValue

#: Size of a covariance beside the errors, by the verdict on the mean NEES.
SIZE = {"consistent": "about right", "optimistic": "too small", "pessimistic": "too large"}
OUTLIERS = "outliers"
#: Shortest form of a verdict on a covariance, for tables in print.
BRIEF = {
    "consistent": "right",
    "optimistic": "too small",
    "pessimistic": "too large",
    "heavy-tailed": OUTLIERS,
    "mixed": "mixed",
    "undecided": "not shown",
}
#: Factor between the mean NEES and its degrees of freedom from which on a covariance is much too small or too large.
MUCH = 2.0
#: Factor from which on the size of a covariance looks wrong, if few runs leave the mean NEES undecided.
LOOKS = 1.5
#: Words for too few runs, and for too many missing estimates.
TOO_FEW, MISSING = "too few runs to say", "too many estimates missing"


def verdict_in_words(
    metric: MetricValue, conditions: Mapping[str, ConditionScores] | None = None, *, whole: bool = True
) -> str:
    """Return a verdict on a covariance in words, such as "about right; too large across the motion".

    Args:
        metric: NEES or NIS; without a verdict the words are empty. The verdict on whiteness is a word already.
        conditions: scores of the tracker by condition, which tell whether estimates are missing.
        whole: whether to add where the covariance is off; else a covariance that is right in the mean is "about right
            overall".
    """
    if metric.value is None or metric.verdict is None:
        return ""
    dof = metric.dof or 1
    if metric.verdict == "undecided":
        return _undecided(metric.value / dof, metric, conditions or {})
    if metric.verdict not in MEANING:
        return metric.verdict
    size, outliers = _size(metric, dof), f", {OUTLIERS}" * ("heavy-tailed" in (metric.verdict, metric.also))
    if metric.verdict == "heavy-tailed":
        near = 1 / LOOKS < metric.value / dof < LOOKS
        return (size or (SIZE["consistent"] if near else _looks(metric.value / dof))) + outliers
    off = dict[str, str]()
    for word, place in _places_off(metric):
        off.setdefault(word, place)
    if metric.verdict in SIZE and size:
        return size + outliers
    # Places where the covariance is right are named only if it is off elsewhere.
    size_word = size or SIZE["consistent"]
    others = [f"{word} {place}" for word, place in off.items() if word not in size_word]
    if metric.verdict in SIZE and not others:
        # Few runs may leave no doubt though there is no interval.
        return SIZE[metric.verdict] + outliers
    if not size:
        return f"{' and '.join(others) if whole else 'off in places'}{outliers}" if others else f"{TOO_FEW}{outliers}"
    return f"{size}; {' and '.join(others)}{outliers}" if whole and others else f"{size} overall{outliers}"


def _size(metric: MetricValue, dof: int) -> str:
    verdict = metric.verdict if metric.ci95 is None else mean_verdict(metric.ci95, dof)
    word = SIZE.get(verdict or "", "")
    low, high = metric.ci95 or (float(metric), float(metric))
    return f"much {word}" if word and (low >= MUCH * dof or high <= dof / MUCH) else word


def _looks(ratio: float) -> str:
    return f"looks {SIZE['optimistic' if ratio > 1 else 'pessimistic']}"


def _undecided(ratio: float, nees: MetricValue, conditions: Mapping[str, ConditionScores]) -> str:
    enough_given = nees.dof is None or meaning(nees, conditions) == MEANING["undecided"]
    why = TOO_FEW if enough_given else MISSING
    if nees.dof is None or 1 / LOOKS < ratio < LOOKS:
        return why
    return f"{_looks(ratio)}; {why}"


def _places_off(nees: MetricValue) -> Iterator[tuple[str, str]]:
    """Yield size and place for each condition where the covariance is off, farthest first, then where it is right."""
    every = [(item.verdict, _where(item.name), item.mean / (nees.dof or 4)) for item in nees.conditions or ()]
    parts = [(part, "") for part in nees.parts or ()]
    parts += [(part, f" {_where(item.name)}") for item in nees.conditions or () for part in item.parts]
    for part, where in parts:
        # Too large a share beyond a point of chi-square means outliers, not a size.
        place = _where(part.name) if part.name in DIRECTIONS else "in the tails"
        if part.verdict in SIZE:
            every.append((part.verdict, place + where, part.value / part.expected))
    every.sort(key=lambda item: (item[0] == "consistent", -abs(math.log(max(item[2], 1e-9)))))
    for verdict, place, _ in every:
        if verdict in SIZE:
            yield SIZE[verdict], place


def _where(condition: str) -> str:
    if condition in HALVES:
        return f"in {condition.removesuffix(' alone')}"
    if condition in DIRECTIONS:
        return f"in {condition}" if "velocity" in condition else condition
    if condition[:1].isdigit():
        return f"at {condition}"
    return {"first second": "in the first second", "straight": "on straights", "sensor gap": "in sensor gaps"}.get(
        condition, f"while {condition}"
    )
