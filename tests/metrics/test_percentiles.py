"""The 95th percentile of the error of each run, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.base.types import Estimate
from trackbench.metrics import BUILT_IN, Scorer, Target, evaluate, merge_sums
from trackbench.metrics.built_in.with_own_sums import percentile


@pytest.mark.parametrize("counted", [1, 2, 7, 40, 41])
def test_it_is_that_of_numpy_and_leaves_out_what_does_not_count(counted: int) -> None:
    errors = np.abs(np.random.default_rng(3).normal(size=(5, 41)))
    errors[:, counted:] = np.nan
    expected = np.nanpercentile(errors, 95, axis=1)
    assert percentile(0.95, errors**2) == pytest.approx(expected, rel=1e-12)


def test_a_run_without_an_estimate_has_none() -> None:
    squares = np.array([[1.0, 4.0], [np.nan, np.nan]])
    assert percentile(0.95, squares) == pytest.approx([1.95, np.nan], nan_ok=True)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.95, 1.0])
@pytest.mark.parametrize("missing", [0.0, 0.1, 0.5, 0.97])
def test_every_share_of_many_rows_is_that_of_numpy(share: float, missing: float) -> None:
    random = np.random.default_rng(7)
    for size in (0, 1, 2, 3, 20, 41):
        squares = np.round(random.normal(size=(50, size)) ** 2, 1)
        squares[random.random(squares.shape) < missing] = np.nan
        rows = [np.sqrt(row[np.isfinite(row)]) for row in squares]
        expected = [np.quantile(row, share) if len(row) else np.nan for row in rows]
        np.testing.assert_allclose(percentile(share, squares.copy()), expected, rtol=1e-12)


def test_it_is_over_instants_and_objects_and_the_mean_over_runs() -> None:
    instants, objects, runs = 30, 2, 4
    random = np.random.default_rng(5)
    due = np.ones((instants, objects, runs), dtype=bool)
    due[:10, 1] = False
    state = np.zeros((4, instants, objects, 1))
    reference = np.zeros((2, instants, objects, 1))
    time, alive = 0.1 * np.arange(instants), np.ones((instants, objects), dtype=bool)
    target = Target(time, state, alive, due, np.zeros_like(due), 100.0, reference)
    mean = random.normal(size=(4, instants, objects * runs))
    blocks = []
    for half in (slice(0, 2), slice(2, 4)):
        own = target._replace(due=due[..., half], starting=target.starting[..., half])
        scorer = Scorer(own, np.zeros((instants, objects, 1), dtype=np.int16), {}, metrics=BUILT_IN)
        for instant in range(instants):
            estimate = mean[:, instant].reshape(4, objects, runs)[..., half].reshape(4, -1)
            scorer.estimate(Estimate(estimate, np.repeat(np.eye(4)[..., None], estimate.shape[1], axis=2)))
        blocks.append(scorer.close())
    found = evaluate(merge_sums(blocks), np.zeros(runs, dtype=int))
    for name, rows in (("position_p95", slice(0, 2)), ("velocity_p95", slice(2, 4))):
        errors = np.hypot(*mean[rows]).reshape(instants, objects, runs)
        per_run = [np.percentile(errors[..., run][due[..., run]], 95) for run in range(runs)]
        assert found.values[name].value == pytest.approx(np.mean(per_run), rel=1e-12)
        assert found.run_columns[f"{name}_per_run"] == pytest.approx(per_run, rel=1e-12)
        assert found.values[name].ci95 is not None
