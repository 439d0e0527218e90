"""Weights of probabilistic association, failures and the order, of sound trackers and of faulty ones."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.faults.bases.gnn import Tracker as NearestGlobal
from benchmarks.faults.bases.jpda import Tracker as Jpda
from tests.support.doctor import SITES, examine_filters_once, looped

from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import Site, TrafficDoctor
from trackbench.subjects.doctor.traffic_checks.association import ended_alone
from trackbench.subjects.doctor.traffic_checks.tracks import order
from trackbench.subjects.doctor.traffic_checks.weights import weights


def outcome(result: PartResult) -> dict[str, bool | None]:
    return {check.name: check.passed for check in result.checks}


class ClutterSquared(Jpda):
    def step(self, state, scan):
        return super().step(state, scan._replace(clutter_density=10 * scan.clutter_density**2))


class WithoutSpread(Jpda):
    """The covariance is that of the nearest detection alone."""

    def updated(self, track, found, weights, scan):
        after = super().updated(track, found, weights, scan)
        z, H, R, _ = found
        if len(z) < 2 or weights[0] > 0.5:
            return after
        S = H[0] @ track.P @ H[0].T + R[0]
        K = track.P @ H[0].T @ np.linalg.inv(S)
        return after._replace(P=track.P - K @ S @ K.T)


def test_the_weights_of_probabilistic_data_association_are_those_of_its_equations() -> None:
    assert outcome(weights(looped(Jpda), SITES["lidar"])) == {
        "weight_of_misses": True,
        "weight_of_clutter": True,
        "spread_of_means": True,
        "spread_of_one": True,
    }


@pytest.mark.parametrize(
    ("tracker", "fault"),
    [
        (ClutterSquared, "clutter_misstated"),
        (WithoutSpread, "covariance_update_wrong"),
    ],
)
def test_wrong_weights_are_named(tracker: type[Jpda], fault: str) -> None:
    assert {finding.fault for finding in weights(looped(tracker), SITES["lidar"]).findings} == {fault}


def test_a_tracker_that_decides_has_no_weights() -> None:
    assert outcome(weights(looped(NearestGlobal), SITES["lidar"])) == {}


def test_a_failure_in_a_scene_is_a_finding_with_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    examine_filters_once(monkeypatch)

    class NoneLeft(NearestGlobal):
        """Fails where two tracks are there and no detection."""

        def assign(self, detections):
            if len(self.tracks) > 1 and not detections:
                raise IndexError("no detection")
            return super().assign(detections)

    found = TrafficDoctor({"lidar": SENSORS["lidar"]}).examine("tracker", looped(NoneLeft))
    first = found.findings[0]
    assert first.fault == "exception_raised"
    assert "IndexError: no detection (" in first.evidence
    assert "test_doctor_traffic_scenes.py:" in first.evidence


def test_a_tracker_that_fails_at_one_object_cannot_be_examined() -> None:
    class Broken(NearestGlobal):
        def assign(self, detections):
            raise KeyError("x")

    with pytest.raises(CannotRun, match="at the detections of one object: KeyError: 'x'"):
        TrafficDoctor({"lidar": SENSORS["lidar"]}).examine("tracker", looped(Broken))


class FirstOfTwins(NearestGlobal):
    """Of new tracks nearer to each other than 0.5 m the first in the list is kept."""

    def step(self, state, scan):
        answer = super().step(state, scan)
        kept = []
        for track in self.tracks:
            if track.scans > 1 or all(np.hypot(*(track.x - one.x)[:2]) > 0.5 for one in kept):
                kept.append(track)
        self.tracks = kept
        return answer


def test_whose_track_starts_where_objects_cannot_be_told_apart_may_depend_on_the_order() -> None:
    assert outcome(order(looped(FirstOfTwins), SITES["lidar"])) == {"order": True}


class DetectionsInOrder(NearestGlobal):
    """Each detection, in the order of the scan, takes the nearest track that is left."""

    def assign(self, detections):
        pairs = []
        for j, detection in enumerate(detections):
            taken = {i for i, _ in pairs}
            near = []
            for i, track in enumerate(self.tracks):
                y, S = track.innovation(detection)
                d2 = y @ np.linalg.solve(S, y)
                near += [(d2, i)] if i not in taken and d2 <= self.gates[len(y)] else []
            pairs += [(min(near)[1], j)] if near else []
        return pairs


def test_established_tracks_that_take_detections_in_an_order_are_found() -> None:
    assert [finding.fault for finding in order(looped(DetectionsInOrder), SITES["lidar"]).findings] == [
        "order_dependent"
    ]


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
def test_a_track_that_is_not_predicted_where_another_ends_is_found(site: Site) -> None:
    class SkipsTheNext(NearestGlobal):
        """The track after one that ends is not predicted."""

        def step(self, state, scan):
            waits = [
                one
                for last, one in zip(self.tracks, self.tracks[1:], strict=False)
                if last.id is not None and scan.time - last.last_seen > self.max_age
            ]
            for track in waits:
                track.predict = lambda dt, sigma: None
            answer = super().step(state, scan)
            for track in waits:
                del track.predict
            return answer

    assert outcome(ended_alone(looped(NearestGlobal), site)) == {"ended_alone": True, "predicted_alone": True}
    assert [finding.fault for finding in ended_alone(looped(SkipsTheNext), site).findings] == ["associated_unpredicted"]
