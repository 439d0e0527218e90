"""Which rows of a track are missing: also where stamps jitter, clocks drift, and many rows are missing."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.truth.row_times import row_period


def frames(random: np.random.Generator, count: int, missing: float) -> np.ndarray:
    kept = random.random(count) >= missing
    kept[[0, -1]] = True
    return np.flatnonzero(kept)


@pytest.mark.parametrize("missing", [0.0, 0.1, 0.2, 0.5])
def test_of_regular_rows_each_that_is_missing_is_found(missing: float) -> None:
    frame = frames(np.random.default_rng(1), 300, missing)
    period, whole = row_period(1.6e9 + 0.1 * frame)
    assert period == pytest.approx(0.1, rel=1e-4)
    np.testing.assert_array_equal(whole, np.diff(frame) == 1)


@pytest.mark.parametrize("rate", [5.0, 50.0])
@pytest.mark.parametrize(("jitter", "share"), [(0.1, 0.0), (0.2, 0.0), (0.3, 0.002), (0.4, 0.02)])
def test_jitter_below_half_a_period_is_no_missing_row(jitter: float, share: float, rate: float) -> None:
    """Over 20 files of 1,000 frames, one in ten missing, by a clock that is fast by 100 millionths."""
    wrong = total = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        frame = frames(random, 1000, 0.1)
        stamp = (frame + random.uniform(-jitter, jitter, len(frame))) * (1 + 1e-4) / rate
        period, whole = row_period(stamp)
        assert period * rate == pytest.approx(1, abs=0.03)
        wrong += int((whole != (np.diff(frame) == 1)).sum())
        total += len(whole)
    # Where each gap is judged by itself, by 1.5 of the median step, 1 % at 30 % and 5 % at 40 % are wrong.
    assert wrong <= share * total


def test_rows_without_a_period_miss_none_up_to_one_and_a_half_median_steps() -> None:
    stamp = np.cumsum(np.random.default_rng(4).exponential(0.1, 400))
    period, whole = row_period(stamp)
    steps = np.diff(stamp)
    assert period == np.median(steps)
    np.testing.assert_array_equal(whole, steps <= 1.5 * period)


def test_a_track_that_was_away_has_its_period_before_and_after() -> None:
    random = np.random.default_rng(5)
    frame = np.concatenate([np.arange(100), np.arange(30_000, 30_100)])
    period, whole = row_period((frame + random.uniform(-0.3, 0.3, 200)) / 10)
    assert period == pytest.approx(0.1, rel=0.01)
    assert np.flatnonzero(~whole).tolist() == [99]


@pytest.mark.parametrize("count", [1, 2])
def test_one_row_or_two(count: int) -> None:
    period, whole = row_period(np.arange(count) / 4)
    assert period == (0.25 if count == 2 else 0.0)
    assert whole.tolist() == [True] * (count - 1)
