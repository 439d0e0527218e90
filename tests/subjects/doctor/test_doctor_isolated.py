"""A tracker of several objects that follows one alone is examined as its filter is."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.faults.bases.gnn import Detection, Track
from benchmarks.faults.bases.gnn import Tracker as NearestGlobal
from tests.support.doctor import looped, tracker_of

from trackbench.base.types import Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.findings import Finding
from trackbench.subjects.doctor.isolated import SingleObjectTracker, examine_filter
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import rank_together

PROBE, LIDAR = GENERAL[0], {"lidar": SENSORS["lidar"]}


def scans(sensor: str, count: int) -> list[Scan]:
    return [PROBE.scan(sensor, SENSORS[sensor], 0.1 * k) for k in range(count)]


def followed(tracker: SingleObjectTracker, given: list[Scan]) -> list[Estimate | None]:
    state, estimates = None, []
    for scan in given:
        state, estimate = tracker.step(state, scan)
        estimates.append(estimate)
    return estimates


@pytest.mark.parametrize("sensor", ["lidar", "radar"])
def test_the_track_of_an_isolated_object_is_the_estimate_of_its_filter(sensor: str) -> None:
    given = scans(sensor, 8)
    given.insert(6, empty_scan(given[5]._replace(time=0.55)))
    own, time = Track(_detection(given[0]), 0.0), 0.0
    found = followed(SingleObjectTracker(looped(NearestGlobal)), given)
    assert found[:2] == [None, None]
    for k, scan in enumerate(given[1:], 1):
        own.predict(scan.time - time, 3.0)
        if scan.valid:
            own.correct(_detection(scan))
        time = scan.time
        if k >= 2:
            estimate = found[k]
            assert estimate is not None
            np.testing.assert_allclose(estimate.mean, own.x, atol=1e-12)
            np.testing.assert_allclose(estimate.covariance, own.P, atol=1e-12)


def _detection(scan: Scan) -> Detection:
    return Detection(scan._replace(measurement=scan.measurement[:, None]), 0)


def test_another_track_is_answered_with_only_where_it_is_detected() -> None:
    given = scans("lidar", 6)
    jump = given[-1]._replace(measurement=given[-1].measurement + 200.0)
    later = [jump._replace(time=0.6 + 0.1 * k) for k in range(4)]
    far = [empty_scan(jump._replace(time=1.0 + 0.1 * k)) for k in range(12)]
    *_, last = followed(SingleObjectTracker(looped(NearestGlobal, max_age=0.3)), given + later)
    assert last is not None
    assert last.mean[0] > 100
    assert followed(SingleObjectTracker(looped(NearestGlobal, max_age=0.3)), given + far)[-1] is None


def test_a_wrong_time_step_is_named() -> None:
    _, findings = examine_filter(LIDAR, looped(tracker_of("predicted_by_one_period")))
    assert findings[0].fault == "wrong_dt"


@pytest.mark.parametrize("name", ["gnn", "sort_like"])
def test_the_filters_of_sound_trackers_have_no_fault(name: str) -> None:
    checks, findings = examine_filter(LIDAR, looped(tracker_of(name)))
    assert findings == []
    assert [check.name for check in checks if check.passed is False] == []
    assert {"prediction", "equations"} <= {check.name for check in checks if check.passed}


def test_a_tracker_that_cannot_be_copied_is_said_not_to_be_examined() -> None:
    class Held(NearestGlobal):
        def __init__(self):
            super().__init__()
            self.generator = (number for number in range(3))

    checks, findings = examine_filter(LIDAR, looped(Held))
    assert findings == []
    assert [(check.name, check.passed) for check in checks] == [("filter", None)]
    assert "cannot be copied (TypeError: cannot pickle 'generator' object" in checks[0].result


def finding(fault: str, cause: str | None = None) -> Finding:
    return Finding(fault, 0.9, "", consequence_of=cause)


@pytest.mark.parametrize(
    ("of_filter", "of_tracks", "expected"),
    [
        (["wrong_dt"], ["gate_too_large"], ["wrong_dt", "gate_too_large<wrong_dt"]),
        (["missed_scan_not_predicted"], ["empty_scan_not_predicted"], ["empty_scan_not_predicted"]),
        ([], ["gate_too_small"], ["gate_too_small"]),
        (["q_too_large"], [], ["q_too_large"]),
    ],
)
def test_what_a_wrong_filter_does_to_its_tracks_is_its_consequence(
    of_filter: list[str], of_tracks: list[str], expected: list[str]
) -> None:
    found = rank_together(list(map(finding, of_filter)), list(map(finding, of_tracks)))
    assert [
        finding.fault + (f"<{finding.consequence_of}" if finding.consequence_of else "") for finding in found
    ] == expected
