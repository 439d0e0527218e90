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
    size = _size(metric.value / dof, mean_verdict(metric.ci95, dof))
    if metric.verdict == "heavy-tailed":
        return f"{size or SIZE['consistent']}, {OUTLIERS}"
    outliers = f", {OUTLIERS}" * (metric.also is not None)
    places = [*_places_off(metric)]
    if metric.verdict in SIZE and (size or not places):
        return (size or _size(metric.value / dof, metric.verdict)) + outliers
    if not size:
        (word, place), *_ = places
        return f"{word} {place if whole else 'in part'}{outliers}"
    other = next((f"{word} {place}" for word, place in places if word not in size), None)
    return f"{size}; {other}{outliers}" if whole and other else f"{size} overall{outliers}"


def _size(ratio: float, verdict: str) -> str:
    """ "about right", "too small", "much too small" and so on; empty of an undecided mean."""
    word = SIZE.get(verdict, "")
    return f"much {word}" if word and not 1 / MUCH < ratio < MUCH else word


def _undecided(ratio: float, nees: MetricValue, conditions: Mapping[str, ConditionScores]) -> str:
    """Why it cannot be said, and to which side a mean that is far off looks."""
    enough_given = nees.dof is None or meaning(nees, conditions) == MEANING["undecided"]
    why = TOO_FEW if enough_given else MISSING
    if nees.dof is None or 1 / LOOKS < ratio < LOOKS:
        return why
    return f"looks {SIZE['optimistic' if ratio > 1 else 'pessimistic']}; {why}"


def _places_off(nees: MetricValue) -> Iterator[tuple[str, str]]:
    """Yield how large the covariance is, and where, for each place where it is off; the farthest off first."""
    every = [(item.verdict, _where(item.name), item.mean / (nees.dof or 4)) for item in nees.conditions or ()]
    every += [(part.verdict, _where(part.name), part.value) for part in nees.parts or () if part.name in DIRECTIONS]
    off = [item for item in every if item[0] in ("optimistic", "pessimistic")]
    # A mixed verdict without any rests on a condition that differs from the mean.
    off = off or [item for item in every if item[0] == "consistent"]
    for verdict, place, _ in sorted(off, key=lambda item: -abs(math.log(max(item[2], 1e-9)))):
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
