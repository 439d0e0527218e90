"""Differences over the stretches of a single run: by the ratio, from four stretches on."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.metrics.contrasts import paired
from trackbench.metrics.intervals import FEWEST_STRETCHES, Interval, ratio, root


def errors(squares: list[float]) -> Interval:
    """A root mean square error over stretches of a single run."""
    return root(ratio(np.array(squares), np.ones(len(squares)), at_least=0.0))._replace(of_stretches=True)


#: Squared errors of ``recorded/udacity_fusion`` in its six stretches, per estimate.
RAW = [0.1109, 0.3351, 0.1490, 0.0995, 0.3641, 0.2419]
UKF = [0.0143, 0.0080, 0.0093, 0.0149, 0.0078, 0.0117]


def test_an_error_four_times_as_large_is_shown_in_six_stretches_and_many_trackers() -> None:
    difference = paired(errors(UKF), errors(RAW), margin=0.005)
    # Of 45 pairs the first has to be below 0.05 / 45.
    assert difference.p_value < 0.05 / 45
    assert difference.ci95 is not None
    low, high = difference.ci95
    assert low < difference.value < high < -0.005
    turned = paired(errors(RAW), errors(UKF), margin=0.005)
    assert turned.ci95 == pytest.approx((-high, -low))
    assert turned.p_value == pytest.approx(difference.p_value)


def test_the_interval_lies_outside_the_margin_exactly_where_the_test_rejects() -> None:
    random = np.random.default_rng(2)
    rejected = 0
    for _ in range(300):
        common = random.gamma(4, 1, 6)
        a, b = (errors((common * random.gamma(8, factor, 6)).tolist()) for factor in (1.0, 1.8))
        difference = paired(a, b, margin=0.3)
        assert difference.ci95 is not None
        outside = difference.ci95[0] > 0.3 or difference.ci95[1] < -0.3
        assert outside == (difference.p_value < 0.05)
        rejected += outside
    assert 30 < rejected < 290


def test_equal_errors_differ_by_nothing() -> None:
    difference = paired(errors(RAW), errors(RAW))
    assert (difference.value, difference.ci95, difference.p_value) == (0.0, (0.0, 0.0), 1.0)


def test_too_few_stretches_judge_nothing() -> None:
    few = FEWEST_STRETCHES - 1
    difference = paired(errors(UKF[:few]), errors(RAW[:few]))
    assert difference.ci95 is None
    assert difference.p_value == 1.0
    assert paired(errors(UKF[: few + 1]), errors(RAW[: few + 1])).ci95 is not None
