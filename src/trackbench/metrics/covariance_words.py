"""A verdict on a covariance in plain words: about right, too small, much too large, outliers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from trackbench.metrics.consistency import DIRECTIONS
from trackbench.metrics.verdicts import HALVES, MEANING, mean_verdict, meaning
from trackbench.results import ConditionScores, MetricValue

#: How large a covariance is beside the errors, by the verdict on the mean NEES.
SIZE = {"consistent": "about right", "optimistic": "too small", "pessimistic": "too large"}
OUTLIERS = "outliers"
#: From which factor between the mean NEES and its degrees of freedom a covariance is much too small or too large.
MUCH = 2.0
#: From which factor a mean that few runs leave open is said to look off.
LOOKS = 1.5
#: What is said where the runs are too few, or too many estimates are missing.
TOO_FEW, MISSING = "too few runs to say", "too many estimates missing"


def verdict_in_words(
    metric: MetricValue, conditions: Mapping[str, ConditionScores] | None = None, *, whole: bool = True
) -> str:
    """Return what a metric says of a covariance, such as "about right; too large across the motion".

    Args:
        metric: a NEES or NIS; the words are empty where it was not judged. The verdict on whiteness is a word already.
        conditions: of the tracker, by which it is known whether estimates are missing.
        whole: with where it is off; else of a covariance that is right in the mean alone "about right overall".
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
    # Where it is right is said of one that is off elsewhere.
    said = size or SIZE["consistent"]
    others = [f"{word} {place}" for word, place in off.items() if word not in said]
    if metric.verdict in SIZE and not others:
        # Of few runs that leave no doubt.
        return SIZE[metric.verdict] + outliers
    if not size:
        return f"{' and '.join(others) if whole else 'off in places'}{outliers}" if others else f"{TOO_FEW}{outliers}"
    return f"{size}; {' and '.join(others)}{outliers}" if whole and others else f"{size} overall{outliers}"


def _size(metric: MetricValue, dof: int) -> str:
    """ "about right", "too small", "much too small" and so on, as the interval of the mean shows; else empty."""
    verdict = metric.verdict if metric.ci95 is None else mean_verdict(metric.ci95, dof)
    word = SIZE.get(verdict or "", "")
    low, high = metric.ci95 or (float(metric), float(metric))
    return f"much {word}" if word and (low >= MUCH * dof or high <= dof / MUCH) else word


def _looks(ratio: float) -> str:
    """ "looks too small", of a mean that few runs leave open."""
    return f"looks {SIZE['optimistic' if ratio > 1 else 'pessimistic']}"


def _undecided(ratio: float, nees: MetricValue, conditions: Mapping[str, ConditionScores]) -> str:
    """Why it cannot be said, and to which side a mean that is far off looks."""
    enough_given = nees.dof is None or meaning(nees, conditions) == MEANING["undecided"]
    why = TOO_FEW if enough_given else MISSING
    if nees.dof is None or 1 / LOOKS < ratio < LOOKS:
        return why
    return f"{_looks(ratio)}; {why}"


def _places_off(nees: MetricValue) -> Iterator[tuple[str, str]]:
    """Yield how large the covariance is, and where, for each place where it is off, the farthest off first; then where
    it is right."""
    every = [(item.verdict, _where(item.name), item.mean / (nees.dof or 4)) for item in nees.conditions or ()]
    parts = [(part, "") for part in nees.parts or ()]
    parts += [(part, f" {_where(item.name)}") for item in nees.conditions or () for part in item.parts]
    for part, where in parts:
        # A share beyond a point of chi-square that is too large is an outlier's.
        place = _where(part.name) if part.name in DIRECTIONS else "in the tails"
        if part.verdict in SIZE:
            every.append((part.verdict, place + where, part.value / part.expected))
    every.sort(key=lambda item: (item[0] == "consistent", -abs(math.log(max(item[2], 1e-9)))))
    for verdict, place, _ in every:
        if verdict in SIZE:
            yield SIZE[verdict], place


def _where(condition: str) -> str:
    """A condition as it stands after a verdict: "while turning", "in velocity across the motion", "at 20 to 50 m"."""
    if condition in HALVES:
        return f"in {condition.removesuffix(' alone')}"
    if condition in DIRECTIONS:
        return f"in {condition}" if "velocity" in condition else condition
    if condition[:1].isdigit():
        return f"at {condition}"
    return {"first second": "in the first second", "straight": "on straights", "sensor gap": "in sensor gaps"}.get(
        condition, f"while {condition}"
    )
