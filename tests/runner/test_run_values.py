"""Metrics of single runs from the sums of a tracker."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.metrics.built_in import BUILT_IN
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.runner.tables import run_values
from trackbench.runner.work import BlockRuns, work_of
from trackbench.scenario.truth import truths_of
from trackbench.subjects.envelope.cells import make_runs

RUNS = 6


def by_run(loaded: tb.Scenario, name: str, metrics: Any) -> tuple[Any, tb.Result]:
    """The sums of one tracker over all runs, and its result."""
    work = work_of(loaded, truths_of(loaded))
    return make_runs(work, [name], [BlockRuns(0, range(RUNS))]).sums[name], tb.run(loaded, workers=1)


@pytest.fixture(scope="module")
def of_lidar() -> tuple[Any, tb.Result]:
    return by_run(tb.load("lidar_only", {"truth.duration_s": 8}, runs=RUNS, trackers=["kf_cv"]), "kf_cv", BUILT_IN)


@pytest.mark.parametrize("name", ["position_rmse", "velocity_rmse", "nees"])
def test_errors_of_each_run_are_those_of_the_run_alone(of_lidar: tuple[Any, tb.Result], name: str) -> None:
    sums, result = of_lidar
    metric = next(metric for metric in BUILT_IN if metric.name == name)
    values = run_values(metric, sums, RUNS)
    rows = result.to_pandas("runs")
    assert values is not None
    np.testing.assert_allclose(values, rows[metric.columns[0]], rtol=1e-12)


def test_scores_of_tracks_of_each_run_are_those_of_the_run_alone() -> None:
    loaded = tb.load("traffic/side_by_side", {"truth.duration_s": 4}, runs=RUNS, trackers=["gnn"])
    sums, result = by_run(loaded, "gnn", TRACK_METRICS)
    values = run_values(TRACK_METRICS["tgospa"], sums, RUNS)
    rows = result.to_pandas("runs")
    total, count = (rows[column] for column in TRACK_METRICS["tgospa"].columns)
    assert values is not None
    np.testing.assert_allclose(values, np.sqrt(total / count), rtol=1e-12)


def test_the_error_of_a_function_in_each_run_is_its_delay() -> None:
    loaded = tb.load("functions/euro_ncap_braking", runs=RUNS, trackers=["ekf_cv_quiet"])
    sums, result = by_run(loaded, "ekf_cv_quiet", loaded.config.own_metrics)
    metric = next(metric for metric in loaded.config.own_metrics if metric.name == "warn_error.lead")
    values = run_values(metric, sums, RUNS)
    delay = result.to_pandas("runs").query("tracker == 'ekf_cv_quiet'")["warn_delay.lead_per_run"]
    assert values is not None
    np.testing.assert_allclose(values, delay.abs(), atol=1e-9)
    assert len({*values.round(6)}) > 1
