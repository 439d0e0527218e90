"""Which rows of a track are missing: also where stamps jitter and many rows are missing."""

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
@pytest.mark.parametrize("jitter", [0.1, 0.2, 0.24])
def test_jitter_below_a_quarter_of_a_period_is_no_missing_row(jitter: float, rate: float) -> None:
    """Over 20 files of 1,000 frames, one in fifty missing."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        frame = frames(random, 1000, 0.02)
        period, whole = row_period((frame + random.uniform(-jitter, jitter, len(frame))) / rate)
        assert period * rate == pytest.approx(1, abs=0.03)
        np.testing.assert_array_equal(whole[np.diff(frame) == 1], True)
        np.testing.assert_array_equal(whole[np.diff(frame) > 2], False)
        assert whole[np.diff(frame) == 2].mean() < 0.2


def test_a_track_that_was_away_has_its_period_before_and_after() -> None:
    random = np.random.default_rng(5)
    frame = np.concatenate([np.arange(100), np.arange(30_000, 30_100)])
    period, whole = row_period((frame + random.uniform(-0.2, 0.2, 200)) / 10)
    assert period == pytest.approx(0.1, rel=0.03)
    assert np.flatnonzero(~whole).tolist() == [99]


@pytest.mark.parametrize("count", [1, 2])
def test_one_row_or_two(count: int) -> None:
    period, whole = row_period(np.arange(count) / 4)
    assert period == (0.25 if count == 2 else 0.0)
    assert whole.tolist() == [True] * (count - 1)
