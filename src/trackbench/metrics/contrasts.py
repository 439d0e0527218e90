"""Differences and ratios of two values with intervals and tests, from the influence of each run, scene or stretch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr, stdtrit

from trackbench.base.types import Array, Mask
from trackbench.metrics.intervals import FEWEST_STRETCHES, ROUNDING, Interval, standard_errors

#: Probability that no scene of a kind is drawn whose share of all scenes is ``undrawn_share``.
UNDRAWN_LEVEL = 0.05
#: Widening of the interval of a difference for kinds of scenes that were not drawn: share of the smaller error over the
#: root of the number of scenes. Chosen on 100 scenes of each world, and checked on 100 others
#: (``benchmarks/calibration/worlds.py``).
UNSEEN = 0.1
#: Share of the smaller error by which a difference must exceed the margin to be shown, where one scene of a hundred may
#: decide; and number of scenes from which on this is not required.
SHARE_OF_ONE, FEW_DECIDE_UNTIL = 0.5, 500


def undrawn_share(scenes: int) -> float:
    """Return the largest share of all scenes that a kind of scene can have though no scene of the kind was sampled.

    A kind with a larger share occurs in a random sample of ``scenes`` scenes with a probability above 95 %. The share
    is about ``3 / scenes`` (Hanley and Lippman-Hand 1983, "If nothing goes wrong, is everything all right?").
    """
    return float(1.0 - UNDRAWN_LEVEL ** (1.0 / scenes))


def turning_factor(scenes: int) -> float:
    """Return the ratio to the mean difference at which an opposite difference in unsampled scenes turns its sign.

    Unsampled scenes are of a kind that the data lack. For root mean squares the factor applies to the mean squares.
    """
    share = undrawn_share(scenes)
    return (1.0 - share) / share


class Contrast(NamedTuple):
    """Difference of two trackers' values of a metric, with its confidence interval and the p-value of a test."""

    value: float
    ci95: tuple[float, float] | None
    """95 % interval. None with fewer than two runs, with several scenes but fewer than ``FEWEST_SCENES``, and where
    neither value varies between runs."""
    p_value: float
    """P-value of the hypothesis that the difference is within the margin: twice the tail probability at the nearer end.
    It is below 5 % exactly where the interval lies outside the margin (Murphy and Myors 1999, "Testing the hypothesis
    that treatments have negligible effects"). Where one scene that was not sampled can decide which tracker is better,
    the possible effect of that scene is added to the margin. Without a margin the test is the two-sided t test; where
    the difference is the same in every run, the sign test. The p-value is 1 with fewer than two runs or
    ``FEWEST_SCENES`` scenes."""
    margin: float
    """Largest difference that does not matter; at least the rounding error."""

    @property
    def equivalent(self) -> bool:
        """Whether the interval lies within the margin: the difference is shown not to matter.

        It is the outcome of two one-sided tests, each at 2.5 % (Schuirmann 1987, "A comparison of the two one-sided
        tests procedure and the power approach").
        """
        return self.ci95 is not None and max(map(abs, self.ci95)) <= self.margin


def paired(a: Interval, b: Interval, margin: float = 0.0) -> Contrast:
    """Return ``a - b`` of values from the same runs (same truth, same noise), by a paired t test over the runs."""
    (contrast,) = all_paired([a, b], [(0, 1)], lambda *_: margin)
    return contrast


def all_paired(
    intervals: Sequence[Interval], pairs: Sequence[tuple[int, int]], margin: Callable[[Interval, Interval], float]
) -> list[Contrast]:
    """Return the paired difference of two values for each of the ``pairs``.

    Over the few stretches of a run, the ratio of two errors is tested: it varies less than their difference where one
    of them is large. With fewer than ``FEWEST_STRETCHES`` stretches nothing is tested.

    Args:
        intervals: values from the same runs.
        pairs: indices of the two values of each pair; pairs with the same first value are fastest side by side.
        margin: returns the largest difference of two values that does not matter.
    """
    values = np.array([item.value for item in intervals])
    influences = np.array([item.corrected for item in intervals])
    constant = np.array([item.constant for item in intervals])
    contrasts: list[Contrast] = []
    for first, same_first in groupby(pairs, key=itemgetter(0)):
        references = np.array([second for _, second in same_first])
        margins = np.array([margin(intervals[first], intervals[second]) for second in references])
        freedom, errors, parts = influences.shape[1] - 1, None, intervals[first].parts
        judged = not parts.too_few and not (intervals[first].of_stretches and parts.number < FEWEST_STRETCHES)
        if judged and all(intervals[number].is_ratio_of_stretches for number in (first, *references)):
            relative = influences / values[:, None]
            errors = standard_errors(relative[first] - relative[references], True)
            contrasts += _tested_by_ratio(values[first], values[references], errors, freedom, margins)
            continue
        if judged:
            differences = influences[first] - influences[references]
            errors = parts.stretch.difference * standard_errors(
                differences, intervals[first].in_time or intervals[first].of_stretches
            )
        varies = ~(constant[first] & constant[references])
        allowed = np.array([_allowed(intervals[first], intervals[second]) for second in references])
        contrasts += _tested(intervals[first].value, values[references], errors, freedom, margins, varies, allowed)
    return contrasts


def unpaired(a: Interval, b: Interval, margin: float = 0.0) -> Contrast:
    """Return ``a - b`` of values from independent runs, by Welch's t test over runs or scenes.

    Source: Welch (1947), "The generalization of Student's problem when several different population variances are
    involved". If the runs do have something in common, the interval is too wide rather than too narrow.
    """
    squares = [(item.parts.stretch.difference * item.error) ** 2 for item in (a, b) if item.error is not None]
    errors, freedom = None, 0.0
    if len(squares) == 2:
        total = sum(squares)
        parts = [square**2 / (len(item.influence) - 1) for square, item in zip(squares, (a, b), strict=True)]
        freedom = total**2 / sum(parts) if total > 0 else min(len(a.influence), len(b.influence)) - 1.0
        errors = np.array([np.sqrt(total)])
    varies, margins, allowed = (np.array([item]) for item in (not (a.constant and b.constant), margin, _allowed(a, b)))
    return _tested(a.value, np.array([b.value]), errors, freedom, margins, varies, allowed)[0]


class LogRatio(NamedTuple):
    """Natural logarithm of the ratio of two positive metric values, with its standard error."""

    value: float
    error: float | None
    """Standard error of the logarithm; None where runs, scenes or stretches of time are too few or do not vary."""
    freedom: int
    """Degrees of freedom of the standard error ``error``, for Student's t."""


def log_ratio(a: Interval, b: Interval, *, is_paired: bool) -> LogRatio | None:
    """Return the natural logarithm of ``a / b``, with its error; None where either value is not positive.

    Args:
        a: numerator.
        b: denominator.
        is_paired: whether both values come from the same runs.
    """
    if min(a.value, b.value) <= 0:
        return None
    value, freedom = float(np.log(a.value / b.value)), min(len(a.influence), len(b.influence)) - 1
    too_few = a.of_stretches and a.parts.number < FEWEST_STRETCHES
    if a.error is None or b.error is None or too_few or (a.constant and b.constant):
        return LogRatio(value, None, freedom)
    error = float(np.hypot(a.error / a.value, b.error / b.value))
    if is_paired:
        difference = a.corrected / a.value - b.corrected / b.value
        error = float(standard_errors(difference[None], a.in_time or a.of_stretches)[0])
    unseen = _allowed(a, b)[0] / min(a.value, b.value) if error > ROUNDING else 0.0
    return LogRatio(value, a.parts.stretch.difference * error + unseen / stdtrit(freedom, 0.975), freedom)


def _allowed(a: Interval, b: Interval) -> tuple[float, float]:
    """Return the allowance for unsampled scenes in a difference of two errors: for its interval, and for its verdict.

    Two trackers can differ in one scene of a hundred alone. Without that scene in the sample, their differences are
    small and the interval of the mean is short: the data do not show what is missing. So the interval allows for a
    share of the errors, which falls as a standard error does. Where simulated vehicles hide others, one scene of a
    hundred made up to 47 % of a mean square error; the root without it is 1.37 times smaller. The verdict allows for a
    larger effect than this share; the interval does not.
    """
    if not all(item.scenes and item.at_least == 0.0 and item.at_most == np.inf for item in (a, b)):
        return 0.0, 0.0
    smaller, scenes = min(a.value, b.value), len(a.influence)
    few_decide = (a.few_decide or b.few_decide) and scenes < FEW_DECIDE_UNTIL
    return UNSEEN * smaller / scenes**0.5, SHARE_OF_ONE * smaller if few_decide else 0.0


def _tested(
    first: float, second: Array, errors: Array | None, freedom: float, margins: Array, varies: Mask, allowed: Array
) -> list[Contrast]:
    values = first - second
    margins = np.maximum(margins, ROUNDING * np.maximum(abs(first), abs(second)))
    if errors is None:
        return [Contrast(value, None, 1.0, top) for value, top in zip(values.tolist(), margins.tolist(), strict=True)]
    # Trackers with the same errors in every run need no allowance.
    in_interval = np.where(errors > ROUNDING * abs(first), allowed[:, 0], 0.0)
    reach = stdtrit(freedom, 0.975) * errors + in_interval
    excess = abs(values) - margins - np.maximum(in_interval, allowed[:, 1])
    positive = errors > 0
    tails = stdtr(freedom, -excess / np.where(positive, errors, 1.0))
    p_values = np.where(positive, np.minimum(1.0, 2 * tails), np.where(excess > 0, 0.5**freedom, 1.0))
    ends = zip((values - reach).tolist(), (values + reach).tolist(), varies.tolist(), strict=True)
    ci95 = [(low, high) if is_known else None for low, high, is_known in ends]
    return list(map(Contrast, values.tolist(), ci95, p_values.tolist(), margins.tolist()))


def _tested_by_ratio(first: float, second: Array, errors: Array, freedom: float, margins: Array) -> list[Contrast]:
    """Test the differences of one value to positive second values ``(k,)``, by the standard errors of the log ratios.

    The ends of an interval are multiples of the smaller value, which is taken as known.
    """
    smaller, larger = np.minimum(first, second), np.maximum(first, second)
    signs = np.where(second > first, -1.0, 1.0)
    ratios, varies, allowed = -np.log(larger / smaller), np.ones(len(second), dtype=bool), np.zeros((len(second), 2))
    tested = _tested(0.0, ratios, errors, freedom, np.log1p(margins / smaller), varies, allowed)
    contrasts = []
    for value, sign, base, limit, item in zip(first - second, signs, smaller, margins, tested, strict=True):
        ends = sorted(sign * base * np.expm1(end) for end in item.ci95 or ())
        contrasts.append(Contrast(float(value), (float(ends[0]), float(ends[1])), item.p_value, float(limit)))
    return contrasts
