"""Weights of probabilistic association, late scans, the drive and failures, of sound trackers and of faulty ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.doctor.traffic.ipda import Ipda
from benchmarks.doctor.traffic.ipda_faults import OneAfterAnother
from benchmarks.doctor.traffic.nearest_faults import DetectionsInOrder, MatchedFirst, TracksInOrder
from benchmarks.doctor.traffic.nearest_global import NearestGlobal
from benchmarks.doctor.traffic.sound import SOUND
from benchmarks.doctor.traffic.subject import Make, looped
from tests.support.doctor import examine_filters_once

from trackbench.driving.faults import TrackFault
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.probes import simplified
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import Site, TrafficDoctor
from trackbench.subjects.doctor.traffic_checks.association import ended_alone
from trackbench.subjects.doctor.traffic_checks.drive import traffic_drive
from trackbench.subjects.doctor.traffic_checks.late import late_scans
from trackbench.subjects.doctor.traffic_checks.tracks import alarms_beside_objects, order
from trackbench.subjects.doctor.traffic_checks.weights import weights

SITES = {name: Site(name, simplified(sensor)) for name, sensor in SENSORS.items()}
LATE = replace(SITES["lidar"], latency=0.2)


def outcome(result: PartResult) -> dict[str, bool | None]:
    return {check.name: check.passed for check in result.checks}


class Pda(Ipda):
    """States no existence."""

    def output(self, tracks):
        shown = super().output(tracks)
        return None if shown is None else shown[:3]


class SureMisses(Pda):
    """A miss has the probability 1 less the density of clutter."""

    def shares(self, tracks, likely, scan):
        chance, self.detects = self.detects(scan), lambda scan: scan.clutter_density
        found = super().shares(tracks, likely * chance / scan.clutter_density, scan)
        del self.detects
        return found


class OwnChance(Pda):
    def detects(self, scan):
        return 0.9


class ClutterSquared(Pda):
    def clutter(self, scan):
        return 10 * scan.clutter_density**2


class PerSquareKilometre(Pda):
    def clutter(self, scan):
        return 1e-6 * scan.clutter_density


class WithoutSpread(Pda):
    def after(self, track, likely, share, scan):
        found = super().after(track, likely, share, scan)
        parts = [self.filter.update(track.x, track.P, scan._replace(measurement=z))[1] for z in scan.measurement.T]
        own = share / max(share.sum(), 1e-300)
        return replace(found, P=sum(w * P for w, P in zip(own, parts, strict=True))) if share.sum() > 0.5 else found


class SpreadOfEach(Pda):
    """Takes the square of the mean's step off for each detection, by its weight: not as a whole."""

    def after(self, track, likely, share, scan):
        found = super().after(track, likely, share, scan)
        return replace(found, P=found.P + (1 - share.sum()) * np.outer(found.x - track.x, found.x - track.x))


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
def test_the_weights_of_probabilistic_data_association_are_those_of_its_equations(site: Site) -> None:
    assert outcome(weights(looped(Pda), site)) == {
        "weight_of_misses": True,
        "weight_of_clutter": True,
        "spread_of_means": True,
        "spread_of_one": True,
    }


@pytest.mark.parametrize(
    ("tracker", "fault"),
    [
        (SureMisses, "pd_misstated"),
        (OwnChance, "pd_misstated"),
        (ClutterSquared, "clutter_misstated"),
        (PerSquareKilometre, "clutter_misstated"),
        (WithoutSpread, "covariance_update_wrong"),
        (SpreadOfEach, "covariance_update_wrong"),
    ],
)
def test_wrong_weights_are_named(tracker: type[Pda], fault: str) -> None:
    assert {finding.fault for finding in weights(looped(tracker), SITES["lidar"]).findings} == {fault}


def test_the_spread_of_a_detection_and_a_miss_shows_where_that_of_two_detections_is_right() -> None:
    assert outcome(weights(looped(SpreadOfEach), SITES["radar"])) == {
        "weight_of_misses": True,
        "weight_of_clutter": True,
        "spread_of_means": True,
        "spread_of_one": False,
    }


@pytest.mark.parametrize("name", ["nearest global", "greedy score", "builtin gnn by score"])
def test_a_tracker_that_decides_has_no_weights(name: str) -> None:
    assert outcome(weights(SOUND[name], SITES["lidar"])) == {}


class Clamped(NearestGlobal):
    """A negative time step counts as none, and the old detections as new."""

    def predict(self, scan):
        super().predict(scan if self.time is None else scan._replace(time=max(scan.time, self.time)))


class AtArrival(NearestGlobal):
    def step(self, state, scan):
        return super().step(state, scan._replace(time=scan.arrival_time))


class Dropping(NearestGlobal):
    def step(self, state, scan):
        if self.time is not None and scan.time < self.time:
            return None, self.report(scan)
        return super().step(state, scan)


@pytest.mark.parametrize(
    ("tracker", "failed"), [(NearestGlobal, []), (Dropping, []), (Clamped, ["late"]), (AtArrival, ["late", "all_late"])]
)
def test_late_scans_that_are_taken_as_new_are_found(tracker: type[NearestGlobal], failed: list[str]) -> None:
    result = late_scans(looped(tracker), LATE)
    assert [check.name for check in result.checks if not check.passed] == failed
    assert len(result.checks) == 2
    assert {finding.fault for finding in result.findings} == ({"late_processed_as_new"} if failed else set())


class Refusing(NearestGlobal):
    def step(self, state, scan):
        if self.time is not None and scan.time < self.time:
            raise ValueError("a scan of the past")
        return super().step(state, scan)


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
def test_of_a_sensor_that_is_not_late_an_old_scan_is_tried_too(site: Site) -> None:
    assert outcome(late_scans(looped(NearestGlobal), site)) == {"late": True}
    assert outcome(late_scans(looped(Dropping), site)) == {"late": True}
    (finding,) = late_scans(looped(Clamped), site).findings
    assert finding.fault == "late_processed_as_new"
    assert finding.evidence.endswith("No sensor here is late: it does harm where a scan comes after a newer one.")


def test_who_raises_at_old_scans_has_a_fault_only_where_they_come() -> None:
    (check,) = late_scans(looped(Refusing), SITES["lidar"]).checks
    assert check.passed is None
    assert check.result.startswith("it fails at a scan that is not newer than the one before: ValueError: a scan of")
    with pytest.raises(TrackFault, match="a scan of the past"):
        late_scans(looped(Refusing), LATE)


def test_scans_at_their_arrival_are_tried_only_of_sensors_that_are_late() -> None:
    assert outcome(late_scans(looped(AtArrival), SITES["lidar"])) == {"late": False}
    late_lidar = {"lidar": SENSORS["lidar"].model_copy(update={"latency_s": 0.2})}
    found = TrafficDoctor(late_lidar).examine("tracker", looped(AtArrival))
    assert found.findings[0].fault == "late_processed_as_new"


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
def test_the_drive_is_passed_by_sound_trackers_and_no_other(site: Site) -> None:
    assert outcome(traffic_drive(looped(NearestGlobal), site)) == {"traffic_drive": True}
    assert outcome(traffic_drive(looped(MatchedFirst), site)) == {"traffic_drive": False}


def test_a_tracker_without_tracks_has_the_gospa_of_all_cars_missed() -> None:
    class Silent(NearestGlobal):
        def reported(self):
            return []

    result = traffic_drive(looped(Silent), SITES["lidar"])
    assert result.checks[0].result.startswith(f"GOSPA is {np.sqrt(6 * 5**2 / 2):.3g} m")


def test_a_failure_in_a_scene_is_a_finding_with_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    examine_filters_once(monkeypatch)

    class NoneLeft(NearestGlobal):
        """Fails where two tracks are there and no detection."""

        def distances(self, scan):
            if len(self.tracks) > 1 and not scan.measurement.shape[1]:
                raise IndexError("no detection")
            return super().distances(scan)

    found = TrafficDoctor({"lidar": SENSORS["lidar"]}).examine("tracker", looped(NoneLeft))
    first = found.findings[0]
    assert first.fault == "exception_raised"
    assert "IndexError: no detection (" in first.evidence
    assert "test_doctor_traffic_scenes.py:" in first.evidence


def test_a_tracker_that_fails_at_one_object_cannot_be_examined() -> None:
    class Broken(NearestGlobal):
        def distances(self, scan):
            raise KeyError("x")

    make: Make = looped(Broken)
    with pytest.raises(CannotRun, match="at the detections of one object: KeyError: 'x'"):
        TrafficDoctor({"lidar": SENSORS["lidar"]}).examine("tracker", make)


class FirstOfTwins(NearestGlobal):
    """Of new tracks nearer to each other than 0.5 m the first in the list is kept."""

    def begun(self, scan, taken):
        kept = []
        for track in super().begun(scan, taken):
            if all(np.hypot(*(track.x - one.x)[:2]) > 0.5 for one in [*self.tracks, *kept]):
                kept.append(track)
        return kept


@pytest.mark.parametrize("tracker", [NearestGlobal, FirstOfTwins])
def test_whose_track_starts_where_objects_cannot_be_told_apart_may_depend_on_the_order(tracker: type) -> None:
    assert outcome(order(looped(tracker), SITES["lidar"])) == {"order": True}


@pytest.mark.parametrize("tracker", [DetectionsInOrder, TracksInOrder, OneAfterAnother])
def test_established_tracks_that_take_detections_in_an_order_are_found(tracker: type) -> None:
    assert [finding.fault for finding in order(looped(tracker), SITES["lidar"]).findings] == ["order_dependent"]


class EachForItself(NearestGlobal):
    """Tracks share detections; of those of one object that coincide the oldest is kept."""

    apart = True

    def associated(self, distances, scan):
        d2 = np.where(self.inside(distances[0], scan), distances[0], np.inf)
        return {k: int(row.argmin()) for k, row in enumerate(d2) if len(row) and row.min() < np.inf}

    def ended(self, track):
        older = self.tracks[: next(k for k, one in enumerate(self.tracks) if one is track)]
        twin = any(np.hypot(*(track.x - one.x)[:2]) < 1.0 for one in older)
        return super().ended(track) or (self.apart and twin)


class TwinsKept(EachForItself):
    apart = False


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
def test_a_false_alarm_beside_an_object_makes_a_second_track_where_tracks_share_detections(site: Site) -> None:
    assert outcome(alarms_beside_objects(looped(NearestGlobal), site)) == {"double_tracks.beside": True}
    assert outcome(alarms_beside_objects(looped(EachForItself), site)) == {"double_tracks.beside": True}
    assert [finding.fault for finding in alarms_beside_objects(looped(TwinsKept), site).findings] == ["double_tracks"]


class SkipsTheNext(NearestGlobal):
    """The track after one that ends is not predicted."""

    def predict(self, scan):
        skipped = [
            one for last, one in zip(self.tracks, self.tracks[1:], strict=False) if last.missed == self.misses - 1
        ]
        places = [(one, one.x, one.P) for one in skipped]
        super().predict(scan)
        for one, x, P in places:
            one.x, one.P = x, P


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
def test_a_track_that_is_not_predicted_where_another_ends_is_found(site: Site) -> None:
    assert outcome(ended_alone(looped(NearestGlobal), site)) == {"ended_alone": True, "predicted_alone": True}
    assert [finding.fault for finding in ended_alone(looped(SkipsTheNext), site).findings] == ["associated_unpredicted"]
