"""Verdicts on covariances in plain words."""

from __future__ import annotations

import pytest

from trackbench.metrics.covariance_words import MISSING, TOO_FEW, verdict_in_words
from trackbench.results import ConditionVerdict, MetricValue, PartVerdict

ALONG = PartVerdict(name="along the motion", value=0.4, expected=1.0, ci95=(0.3, 0.5), verdict="pessimistic")
ACROSS = PartVerdict(name="across the motion", value=3.0, expected=1.0, ci95=(2.5, 3.5), verdict="optimistic")
TAIL = PartVerdict(name="beyond the 95 % point", value=0.01, expected=0.05, ci95=(0.0, 0.02), verdict="pessimistic")


def under(name: str, mean: float, verdict: str, *parts: PartVerdict) -> ConditionVerdict:
    return ConditionVerdict(name=name, mean=mean, ci95=(0.95 * mean, 1.05 * mean), verdict=verdict, parts=parts)


def nees(mean: float, ci95: tuple[float, float], verdict: str, *conditions: ConditionVerdict, **more) -> MetricValue:
    return MetricValue(unit="1", value=mean, ci95=ci95, dof=4, verdict=verdict, conditions=conditions, **more)


@pytest.mark.parametrize(
    ("metric", "words"),
    [
        (nees(4.0, (3.9, 4.1), "consistent"), "about right"),
        (nees(6.0, (5.5, 6.5), "optimistic"), "too small"),
        (nees(12.0, (11.0, 13.0), "optimistic"), "much too small"),
        (nees(8.1, (4.5, 12.0), "optimistic"), "too small"),
        (nees(1.0, (0.9, 1.1), "pessimistic", also="heavy-tailed"), "much too large, outliers"),
        (nees(4.0, (3.9, 4.1), "heavy-tailed"), "about right, outliers"),
        (nees(7.0, (3.9, 15.0), "heavy-tailed"), "looks too small, outliers"),
        (nees(9.0, (3.0, 15.0), "undecided"), f"looks too small; {TOO_FEW}"),
        (nees(9.0, (4.0, 15.0), "optimistic"), "too small"),
        (nees(3.9, (3.5, 4.5), "optimistic", under("turning", 4.5, "consistent", ACROSS)),
         "too small across the motion while turning"),
        (nees(4.4, (3.5, 5.5), "pessimistic", parts=(TAIL,)), "too large in the tails"),
        (nees(4.0, (3.9, 4.1), "mixed", under("turning", 40.0, "optimistic"), under("straight", 0.3, "pessimistic")),
         "about right; too large on straights and too small while turning"),
        (nees(12.0, (11.0, 13.0), "mixed", under("turning", 60.0, "optimistic"), under("straight", 4.0, "consistent")),
         "much too small; about right on straights"),
        (nees(4.4, (3.4, 5.4), "mixed", under("turning", 4.4, "undecided", ACROSS, ALONG)),
         "too small across the motion while turning and too large along the motion while turning"),
        (MetricValue(unit="1", value=0.01, ci95=(0.0, 0.02), verdict="white"), "white"),
        (MetricValue(unit="1", value=2.0, dof=2, verdict=None), ""),
    ],
)  # fmt: skip
def test_what_is_said_of_a_covariance(metric: MetricValue, words: str) -> None:
    assert verdict_in_words(metric) == words
    assert len(verdict_in_words(metric, whole=False)) <= max(len(words), 30)


def test_missing_estimates_are_the_reason_where_they_are() -> None:
    assert MISSING not in verdict_in_words(nees(4.0, (3.0, 5.0), "undecided"))
