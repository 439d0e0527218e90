"""A run can be watched while it is made, and is the same as one that is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.runner.block import Observation
from trackbench.runner.run import run
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truth_of


@pytest.mark.parametrize("workers", [1, 2])
def test_the_recorded_run_is_observed_whole_whichever_process_makes_it(tiny: Path, workers: int) -> None:
    # Two blocks, the recorded run in the second one.
    loaded = load_scenario(tiny, ["monte_carlo.runs=1500", "recording.run=1400"])
    truth = truth_of(loaded)
    seen: list[Any] = []
    result = run(loaded, truth, workers=workers, observer=seen.append)
    scans, *observations = seen
    assert {scan.sensor for scan in scans} == {"radar", "lidar"}
    assert all(isinstance(item, Observation) for item in observations)
    assert [item.tracker for item in observations] == ["raw"] * 21 + ["ekf"] * 21
    assert [item.instant for item in observations] == 2 * list(range(21))
    rows = [row for row in result.tables["estimates"].to_pylist() if row["tracker"] == "ekf"]
    for i, name in enumerate(truth.truth.ids):
        table = [row["px_m"] for row in rows if row["object"] == name]
        seen_x = [item.mean[0, i] for item in observations if item.tracker == "ekf"]
        np.testing.assert_array_equal(np.array(table, dtype=float), seen_x)


def test_observing_changes_nothing(tiny: Path) -> None:
    loaded = load_scenario(tiny)
    truth = truth_of(loaded)
    alone, observed = run(loaded, truth), run(loaded, truth, observer=lambda _: None)
    assert alone.summary.fingerprint == observed.summary.fingerprint
    assert all(alone.tables[name].equals(observed.tables[name]) for name in alone.tables)
