"""The benchmark's filters: both engines, other packages and C++ with Eigen give the same, and are then timed."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.eigen import programs

from benchmarks import engines, filters
from trackbench.engine.machine import unavailable


@pytest.fixture(scope="module")
def problem() -> engines.Problem:
    return engines.problem(runs=3, steps=60)


@pytest.mark.parametrize("name", ["EKF, CV", pytest.param("UKF, CTRV", marks=pytest.mark.slow)])
def test_filters_in_cpp_give_the_same_estimates(problem: engines.Problem, name: str, tmp_path: Path):
    try:
        program = programs.program(problem, name, tmp_path)
    except programs.Missing as reason:
        pytest.skip(str(reason))
    expected = engines.estimates(problem, name)
    np.testing.assert_allclose(program.estimates(), expected, rtol=0, atol=1e-9)
    assert program.run() > 0


@pytest.mark.slow
@pytest.mark.skipif(unavailable() is not None, reason=unavailable() or "")
def test_all_agree_and_are_timed(monkeypatch):
    for name, value in {"RUNS": 10, "STEPS": 20, "PEER_RUNS": 2}.items():
        monkeypatch.setattr(filters, name, value)
    # Their compilation is tested above.
    monkeypatch.setattr(filters, "SOURCES", {})
    found = filters.measure(1)
    measured = {(row["problem"], row["engine"]) for row in found["microseconds_per_step"]}
    compared = {(row["problem"], row["engine"]) for row in found["largest_difference"]}
    assert {(name, by) for name in engines.TRACKERS for by in ("fused", "numpy")} < measured
    assert compared < measured
    assert all(row["value"] > 0 for row in found["microseconds_per_step"])
