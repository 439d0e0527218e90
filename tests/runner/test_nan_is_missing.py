"""An estimate of NaN is missing and charged, whether a tracker follows one object or a batch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.runner.test_leaks import STEADY

import trackbench as tb

TRACKERS = """
import numpy as np


class Single:
    def step(self, state, scan):
        silent = 2 < scan.time < 3 and (state is None or state[1] > 0)
        first = scan.measurement[1] if state is None else state[1]
        mean = np.array([*scan.measurement, 0.0, 0.0])
        return (scan.time, first), (np.full(4, np.nan) if silent else mean, np.eye(4))


class Batch:
    batched = True

    def step(self, state, scan):
        first = scan.measurement[1] if state is None else state
        mean = np.concatenate([scan.measurement, np.zeros((2, scan.valid.size))])
        if 2 < scan.time < 3:
            mean[:, first > 0] = np.nan
        return first, (mean, np.eye(4)[:, :, None] + np.zeros(scan.valid.size))
"""


def test_one_member_that_gives_nan_for_a_while_is_charged_for_it(
    tmp_path: Path, write_module: Callable[[Path, str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    module = write_module(tmp_path, TRACKERS)
    trackers = {name: {"use": f"{module}:{name}"} for name in ("Single", "Batch")}
    result = tb.run(tb.load({**STEADY, "trackers": trackers}, runs=6))
    single, batch = result["Single"], result["Batch"]
    assert single.failed is None
    assert batch.failed is None
    missing = single.health.missing_estimates
    assert missing is not None
    assert 0 < missing < 6 * 10
    assert missing == batch.health.missing_estimates
    for path in ("position_rmse", "velocity_rmse", "nees"):
        assert single.metrics[path].value == pytest.approx(batch.metrics[path].value, rel=1e-12)
    assert single.position_rmse.charged_share == pytest.approx(batch.position_rmse.charged_share)
    assert single.position_rmse.charged_share
