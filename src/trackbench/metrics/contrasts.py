"""Differences of two values with their intervals and tests, from what each run, scene or stretch adds to both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr, stdtrit

from trackbench.base.types import Array, Mask
from trackbench.metrics.intervals import FEWEST_STRETCHES, ROUNDING, Interval, standard_errors

#: Probability with which none of a kind of scene is drawn, at the share that ``undrawn_share`` returns.
UNDRAWN_LEVEL = 0.05
#: Share of the smaller of two errors, over the root of the number of scenes, that the interval of their difference
#: allows for scenes of a kind that was not drawn. Chosen on 100 scenes of each world, and checked on 100 others
#: (``benchmarks/calibration/worlds.py``).
UNSEEN = 0.1
#: Where one scene of a hundred may decide, and with fewer than so many scenes: by which share of the smaller error a
#: difference must exceed the margin to be shown.
SHARE_OF_ONE, FEW_DECIDE_UNTIL = 0.5, 500


def undrawn_share(scenes: int) -> float:
    """Return which share of all scenes a kind of scene may make up of which none was drawn.

    At a larger share one is drawn with more than 95 %; it is about ``3 / scenes`` (Hanley and Lippman-Hand 1983, "If
    nothing goes wrong, is everything all right?").
    """
    return float(1.0 - UNDRAWN_LEVEL ** (1.0 / scenes))


def turning_factor(scenes: int) -> float:
    """Return how many times as large as the mean difference, and opposite, that of the undrawn kind must be.

    From there on it turns the sign of the mean over all scenes. Of root mean squares it is that of the mean squares.
    """
    share = undrawn_share(scenes)
    return (1.0 - share) / share


class Contrast(NamedTuple):
    """A difference of two values."""

    value: float
    ci95: tuple[float, float] | None
    """None with fewer than two runs or ``FEWEST_SCENES`` scenes, and where each of the two values is the same in every
    run."""
    p_value: float
    """Probability under the hypothesis of a difference within the margin: twice that of the nearer end, below 5 %
    exactly where the interval lies outside the margin (Murphy and Myors 1999, "Testing the hypothesis that treatments
    have negligible effects"). Where one scene may decide, what it may is added to the margin. Without a margin that of
    the two-sided t test; where the difference is the same in every run that of the sign test; 1 with fewer than two
    runs or ``FEWEST_SCENES`` scenes."""
    margin: float
    """Up to this a difference does not matter; at least what rounding makes."""

    @property
    def equivalent(self) -> bool:
        """Whether the interval lies within the margin.

        So the two one-sided tests show, each at 2.5 % (Schuirmann 1987, "A comparison of the two one-sided tests
        procedure and the power approach").
        """
        return self.ci95 is not None and max(map(abs, self.ci95)) <= self.margin


def paired(a: Interval, b: Interval, margin: float = 0.0) -> Contrast:
    """``a - b`` where both come from the same runs (same truth, same noise), by a paired t test on the influences."""
    (contrast,) = all_paired([a, b], [(0, 1)], lambda *_: margin)
    return contrast


def all_paired(
    intervals: Sequence[Interval], pairs: Sequence[tuple[int, int]], margin: Callable[[Interval, Interval], float]
) -> list[Contrast]:
    """Test many pairs as ``paired`` does; pairs of one first interval that follow each other are computed together.

    Over the stretches of a run, of which there are few, the ratio of two errors is tested: it varies less than their
    difference where one of them is large. Fewer than ``FEWEST_STRETCHES`` judge nothing.

    Args:
        intervals: from the same runs.
        pairs: by their places.
        margin: of two of them.
    """
    values = np.array([item.value for item in intervals])
    influences = np.array([item.corrected for item in intervals])
    constant = np.array([item.constant for item in intervals])
    contrasts: list[Contrast] = []
    for first, own in groupby(pairs, key=itemgetter(0)):
        others = np.array([other for _, other in own])
        margins = np.array([margin(intervals[first], intervals[other]) for other in others])
        freedom, errors, parts = influences.shape[1] - 1, None, intervals[first].parts
        judged = not parts.too_few and not (intervals[first].of_stretches and parts.number < FEWEST_STRETCHES)
        if judged and all(intervals[number].is_ratio_of_stretches for number in (first, *others)):
            relative = influences / values[:, None]
            errors = standard_errors(relative[first] - relative[others], True)
            contrasts += _tested_by_ratio(values[first], values[others], errors, freedom, margins)
            continue
        if judged:
            apart = influences[first] - influences[others]
            errors = parts.stretch.difference * standard_errors(
                apart, intervals[first].in_time or intervals[first].of_stretches
            )
        varies = ~(constant[first] & constant[others])
        allowed = np.array([_allowed(intervals[first], intervals[other]) for other in others])
        contrasts += _tested(intervals[first].value, values[others], errors, freedom, margins, varies, allowed)
    return contrasts


def unpaired(a: Interval, b: Interval, margin: float = 0.0) -> Contrast:
    """``a - b`` where the runs of one have nothing to do with those of the other, by Welch's t test on the influences.

    Source: Welch (1947), "The generalization of Student's problem when several different population variances are
    involved". Where the runs have something in common after all, the interval is too wide rather than too narrow.
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
    """The logarithm of the ratio of two positive values."""

    value: float
    error: float | None
    """Its standard error; None where the runs, scenes or stretches are too few or tell nothing."""
    freedom: int
    """Degrees of freedom of the error."""


def log_ratio(a: Interval, b: Interval, *, is_paired: bool) -> LogRatio | None:
    """Return the logarithm of ``a / b``; None where either is not positive.

    Args:
        a: the one value.
        b: the other.
        is_paired: whether both come from the same runs.
    """
    if min(a.value, b.value) <= 0:
        return None
    value, freedom = float(np.log(a.value / b.value)), min(len(a.influence), len(b.influence)) - 1
    too_few = a.of_stretches and a.parts.number < FEWEST_STRETCHES
    if a.error is None or b.error is None or too_few or (a.constant and b.constant):
        return LogRatio(value, None, freedom)
    error = float(np.hypot(a.error / a.value, b.error / b.value))
    if is_paired:
        apart = a.corrected / a.value - b.corrected / b.value
        error = float(standard_errors(apart[None], a.in_time or a.of_stretches)[0])
    unseen = _allowed(a, b)[0] / min(a.value, b.value) if error > ROUNDING else 0.0
    return LogRatio(value, a.parts.stretch.difference * error + unseen / stdtrit(freedom, 0.975), freedom)


def _allowed(a: Interval, b: Interval) -> tuple[float, float]:
    """Return what a difference of two errors allows for scenes that were not drawn: in its interval, and in a verdict.

    Two trackers may differ in one scene of a hundred alone. Where it is not drawn, their differences are small and the
    interval of the mean is short: the differences themselves do not show what is missing. So the interval allows for a
    share of the errors, which falls as a standard error does. Where simulated vehicles hide others, one scene of a
    hundred made up to 47 % of a mean square error, which makes the root without it 1.37 times smaller: a verdict allows
    for more than that, and the interval leaves such a scene out.
    """
    if not all(item.scenes and item.at_least == 0.0 and item.at_most == np.inf for item in (a, b)):
        return 0.0, 0.0
    smaller, scenes = min(a.value, b.value), len(a.influence)
    few_decide = (a.few_decide or b.few_decide) and scenes < FEW_DECIDE_UNTIL
    return UNSEEN * smaller / scenes**0.5, SHARE_OF_ONE * smaller if few_decide else 0.0


def _tested(
    first: float, others: Array, errors: Array | None, freedom: float, margins: Array, varies: Mask, allowed: Array
) -> list[Contrast]:
    """``(k,)`` differences of one value and others with their intervals and p-values, from their standard errors;
    ``varies`` is whether the runs tell anything of the errors, ``allowed`` ``(k, 2)`` as of ``_allowed``."""
    values = first - others
    margins = np.maximum(margins, ROUNDING * np.maximum(abs(first), abs(others)))
    if errors is None:
        return [Contrast(value, None, 1.0, own) for value, own in zip(values.tolist(), margins.tolist(), strict=True)]
    # Two that do the same in every run are the same.
    in_interval = np.where(errors > ROUNDING * abs(first), allowed[:, 0], 0.0)
    reach = stdtrit(freedom, 0.975) * errors + in_interval
    excess = abs(values) - margins - np.maximum(in_interval, allowed[:, 1])
    positive = errors > 0
    tails = stdtr(freedom, -excess / np.where(positive, errors, 1.0))
    p_values = np.where(positive, np.minimum(1.0, 2 * tails), np.where(excess > 0, 0.5**freedom, 1.0))
    ends = zip((values - reach).tolist(), (values + reach).tolist(), varies.tolist(), strict=True)
    ci95 = [(low, high) if own else None for low, high, own in ends]
    return list(map(Contrast, values.tolist(), ci95, p_values.tolist(), margins.tolist()))


def _tested_by_ratio(first: float, others: Array, errors: Array, freedom: float, margins: Array) -> list[Contrast]:
    """``(k,)`` differences of one positive value and others, from the standard errors of the logarithms of the ratios.

    The smaller value stands for itself in both ends: the larger one is a multiple of it.
    """
    smaller, larger = np.minimum(first, others), np.maximum(first, others)
    signs = np.where(others > first, -1.0, 1.0)
    ratios, all_vary, nothing = -np.log(larger / smaller), np.ones(len(others), dtype=bool), np.zeros((len(others), 2))
    tested = _tested(0.0, ratios, errors, freedom, np.log1p(margins / smaller), all_vary, nothing)
    contrasts = []
    for value, sign, least, own, item in zip(first - others, signs, smaller, margins, tested, strict=True):
        ends = sorted(sign * least * np.expm1(end) for end in item.ci95 or ())
        contrasts.append(Contrast(float(value), (float(ends[0]), float(ends[1])), item.p_value, float(own)))
    return contrasts
