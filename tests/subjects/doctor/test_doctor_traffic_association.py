"""Each check of association, on a sound tracker and on the same one with a fault."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest
from benchmarks.doctor.traffic.nearest_faults import (
    AssignedIsSeen,
    Farthest,
    GatedLast,
    LargestSum,
    LastRemoved,
    MatchedFirst,
    NewOnesWait,
    NoGate,
    PoppedInOrder,
)
from benchmarks.doctor.traffic.nearest_global import NearestGlobal
from benchmarks.doctor.traffic.sound import SOUND
from benchmarks.doctor.traffic.subject import Make, looped

from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.site import simplified
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import Site, TrafficDoctor
from trackbench.subjects.doctor.traffic_checks.association import (
    allowed_pair,
    ended_alone,
    missed_among_others,
    nearer_of_two,
    new_predicted,
    predicted_place,
)

CHECKS = (nearer_of_two, predicted_place, new_predicted, allowed_pair, missed_among_others, ended_alone)
SITES = {name: Site(name, simplified(sensor)) for name, sensor in SENSORS.items()}


def names(result: PartResult) -> list[str]:
    return [finding.fault for finding in result.findings]


@cache
def sound_outcomes(check: Callable[[Make, Site], PartResult], sensor: str) -> set[bool | None]:
    """Whether the checks of a tracker without a fault pass."""
    return {one.passed for one in check(looped(NearestGlobal), SITES[sensor]).checks}


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
@pytest.mark.parametrize(
    ("check", "tracker", "fault"),
    [
        (nearer_of_two, LargestSum, "assignment_inverted"),
        (nearer_of_two, Farthest, "assignment_inverted"),
        (new_predicted, NewOnesWait, "associated_unpredicted"),
        (predicted_place, MatchedFirst, "associated_unpredicted"),
        (allowed_pair, GatedLast, "gated_after_assignment"),
        (missed_among_others, AssignedIsSeen, "never_deletes"),
        (ended_alone, PoppedInOrder, "wrong_track_deleted"),
        (ended_alone, LastRemoved, "wrong_track_deleted"),
    ],
)
def test_a_fault_fails_its_check(check, tracker: type[NearestGlobal], fault: str, site: Site) -> None:
    assert names(check(looped(tracker), site)) == [fault]
    assert sound_outcomes(check, site.name) == {True}


class OwnColumn(NearestGlobal):
    """Each track takes the first detection in its gate: neither the nearer nor the farther one."""

    def associated(self, distances, scan):
        inside = self.inside(distances[0], scan)
        return {k: int(row.argmax()) for k, row in enumerate(inside) if row.any()}


def test_who_takes_the_first_detection_does_not_take_the_farthest() -> None:
    assert names(nearer_of_two(looped(OwnColumn), SITES["lidar"])) == []


def test_the_farthest_detection_is_named_before_what_it_brings_about() -> None:
    first, *others = TrafficDoctor({"lidar": SENSORS["lidar"]}).examine("tracker", looped(LargestSum)).findings
    assert first.fault == "assignment_inverted"
    assert {one.consequence_of for one in others} <= {"assignment_inverted"}


class BeginsAtTheLast(NewOnesWait):
    """A new track has no motion: it is at the last detection."""

    def reported(self):
        for track in self.tracks:
            if track.id < 0 or track.hits == self.confirm[0]:
                track.x, track.P = self.at(track)
        return super().reported()

    def begun(self, scan, taken):
        self.scan = scan
        return super().begun(scan, taken)

    def at(self, track):
        if track.used < 0:
            return track.x, track.P
        begun = self.born(self.scan, track.used)
        return begun.x, begun.P


@pytest.mark.parametrize("site", SITES.values(), ids=SITES)
def test_a_track_that_begins_with_its_last_detection_need_not_be_predicted_before(site: Site) -> None:
    (check,) = new_predicted(looped(BeginsAtTheLast, confirm=(3, 4)), site).checks
    assert check.passed


@pytest.mark.parametrize("name", ["nearest global kf", "greedy score", "builtin jpda", "builtin pmb"])
def test_sound_trackers_pass(name: str) -> None:
    results = [check(SOUND[name], SITES["lidar"]) for check in CHECKS]
    assert [(one.name, one.passed) for result in results for one in result.checks if not one.passed] == []


def test_without_a_gate_each_track_takes_the_nearer_of_two_detections() -> None:
    """The likelihood decides; what no gate allows is far from both."""
    assert names(predicted_place(looped(NoGate), SITES["lidar"])) == []


def test_a_tracker_without_a_track_is_asked_nothing() -> None:
    class Silent(NearestGlobal):
        def reported(self):
            return []

    make: Make = looped(Silent)
    assert [check(make, SITES["lidar"]).checks for check in CHECKS] == [[]] * len(CHECKS)
