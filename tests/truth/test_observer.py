"""A run can be watched while it is made, and its result is the same as without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.base.execution import executor
from trackbench.runner.recorded import RecordedInstant
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truth_of


@pytest.mark.parametrize("workers", [1, 2])
def test_the_recorded_run_is_seen_whole_whichever_process_makes_it(tiny: Path, workers: int) -> None:
    # Two blocks, the recorded run in the second one.
    loaded = load_scenario(tiny, ["monte_carlo.runs=1500", "recording.run=1400"])
    truth = truth_of(loaded)
    seen: list[Any] = []
    with executor(workers) as chosen:
        result = run_scenario(loaded, [truth], executor=chosen, on_recorded_run=seen.append)
    scans, *instants = seen
    assert {scan.sensor for scan in scans} == {"radar", "lidar"}
    assert all(isinstance(item, RecordedInstant) for item in instants)
    assert [(item.number, *item.estimates) for item in instants] == [
        (n, name) for name in ("raw", "ekf") for n in range(21)
    ]
    for tracker in ("raw", "ekf"):
        rows = [row for row in result.tables.estimates.to_pylist() if row["tracker"] == tracker]
        for i, name in enumerate(truth.truth.ids):
            table = [row["px_m"] for row in rows if row["object"] == name]
            seen_x = [item.estimates[tracker].mean[0, i] for item in instants if tracker in item.estimates]
            np.testing.assert_array_equal(np.array(table, dtype=float), seen_x)
