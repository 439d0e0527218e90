"""Logs with reference boxes and detections that nobody labelled, from the files to the result."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support.exported import write_scenes

from trackbench.base.types import RecordedDetections, Scan
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.runner.work import work_of
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.detections import sense_hidden

SHORT = ["monte_carlo.runs=1", "truth.duration_s=15", "expect=[]"]
TRACKERS = "trackers={gnn: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn}}, jpda: \
{filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: jpda}}}"


@pytest.fixture(scope="module")
def original() -> Scenario:
    return load_scenario("traffic/cut_in", [*SHORT, TRACKERS])


@pytest.fixture(scope="module")
def of_simulation(original: Scenario) -> Result:
    return result(original)


def result(loaded: Scenario) -> Result:
    return run_scenario(loaded, truths_of(loaded))


def scans(loaded: Scenario) -> list[Scan]:
    work = work_of(loaded, truths_of(loaded))
    return sense_hidden(work.scenes[0].sensors, work.seed, work.noise_of(0), range(1)).scans


def sets(scan: Scan) -> list[tuple[float, ...]]:
    return sorted(tuple(column) for column in scan.measurement[:, scan.valid[:, 0], 0].T.tolist())


@pytest.mark.parametrize("labelled", [False, True])
def test_a_scenario_written_as_a_log_has_the_same_detections_and_scores(
    tmp_path: Path, original: Scenario, of_simulation: Result, labelled: bool
) -> None:
    file, made = write_scenes(tmp_path, original, labelled=labelled)
    log = load_scenario(file, [TRACKERS])
    (read,) = truths_of(log)
    truth = made[0][0]
    assert read.measurements is not None
    assert isinstance(read.measurements["front_radar"], RecordedDetections) != labelled
    assert set(read.truth.ids) == set(truth.ids)
    order = [read.truth.ids.index(name) for name in truth.ids]
    np.testing.assert_array_equal(read.truth.time, truth.time.round(9))
    for name in ("px", "py", "heading"):
        np.testing.assert_allclose(getattr(read.truth, name)[:, order], getattr(truth, name), atol=1e-9)
    for name in ("px", "py", "vx", "vy", "yaw", "yaw_rate"):
        np.testing.assert_array_equal(getattr(read.truth.observer, name), getattr(truth.observer, name))
    ours, theirs = scans(log), scans(original)
    assert [(scan.time, scan.sensor) for scan in ours] == [(round(scan.time, 9), scan.sensor) for scan in theirs]
    for own, other in zip(ours, theirs, strict=True):
        assert sets(own) == sets(other)
    of_log = result(log)
    assert of_log.summary.ranking == of_simulation.summary.ranking
    for tracker in of_log.summary.trackers:
        for metric in ("gospa", "tgospa", "hota", "mota", "idf1", "position_rmse", "false_tracks", "matched_share"):
            expected = of_simulation[tracker.name].metrics[metric].value
            assert tracker.metrics[metric].value == pytest.approx(expected, rel=1e-6), metric
        told = tracker.metrics["association_right"]
        assert (told.value is not None) == labelled
        if not labelled:
            assert told.reason == "the recording does not say of which object a detection is"
