"""What late scans of a sensor do that the scenario says is late: an old one; and many that all arrive late."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Tracks
from trackbench.subjects.doctor.findings import KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.traffic import (
    OBJECTS,
    RATE,
    Make,
    MultiObjectSession,
    Site,
    column_of_nearest,
    moved_objects,
)

#: An old scan is older than the latest one by the latency of its sensor, within these, s.
LEAST, MOST = 0.1, 0.5
#: How long objects are followed, s.
FOLLOWED = 2.0
#: Shares of the speed with which they move where an old scan is tried, until one is clear: it has to be within the gate
#: if it counts as new.
SLOW = (0.3, 0.6)
#: How near the tracks are to those after a scan that counts as new, in shares of what that moves them by.
NEAR = 0.2
#: What a scan that counts as new has to move a track by to be told from one that is left out, m.
CLEAR = 0.05
#: Share of the latency by which tracks are behind their objects, from which on it is left out.
BEHIND = 0.5


@doctor_check(
    Question("late", "Is an old scan held against where the objects were?"),
    Question("all_late", "Are tracks predicted from when a scan was taken, not from when it arrived?"),
    place=80,
    faults={
        "late_processed_as_new": KnownFault(
            "a late measurement is processed as if it were new",
            "Where the time since the last scan is computed, and where the time of a scan is read.",
            "Compare scan.time with the state's time: drop an older scan, or go back to its time; arrival_time is not "
            "its time.",
            Role(),
        )
    },
)
def late_scans(make: Make, site: Site) -> PartResult:
    """An old scan after newer ones, given late and as if it were new; and scans that are all late."""
    result = PartResult()
    if site.latency > 0.0:
        age = float(np.clip(site.latency, LEAST, MOST))
        _old_scan(make, site, age, result)
        _all_late(make, site, age, result)
    return result


def _old_scan(make: Make, site: Site, age: float, result: PartResult) -> None:
    clear = next((moves for share in SLOW if (moves := _clear_moves(make, site, age, share))), None)
    if clear is None:
        return
    taken = [np.hypot(*(own - new)) < NEAR * np.hypot(*new) for own, new in clear]
    own, new = max(clear, key=lambda move: float(np.hypot(*move[1])))
    text = (
        f"after a scan that is older by {age:g} s than the one before, a track is {np.hypot(*own):.2f} m from where it "
        f"was without; if the scan were new that would be {np.hypot(*new):.2f} m ({sum(taken)} of {len(clear)} tracks "
        "as if new)"
    )
    result.note("late", 2 * sum(taken) <= len(clear), text, "late_processed_as_new")


def _clear_moves(make: Make, site: Site, age: float, share: float) -> list[tuple[Array, Array]]:
    """How far tracks go by an old scan given late, and given as new where that is clear, ``(2,)`` m."""
    objects = OBJECTS * np.array([[1], [1], [share], [share]])
    scans, random = site.scans(objects, FOLLOWED), np.random.default_rng(0)
    latest = scans[-1].time
    old = site.scan(latest - age, site.detections(objects, latest - age), random)._replace(arrival_time=latest)
    empty = site.scan(latest + 1 / RATE, old.measurement[:, :0], random)._replace(asked=True)
    without, given_late, as_new = (
        MultiObjectSession(make).follow([*scans, *more, empty])[-1] for more in ([], [old], [old._replace(time=latest)])
    )
    moves = []
    for target in moved_objects(objects, empty.time).T:
        places = [_place(tracks, target) for tracks in (without, given_late, as_new)]
        if all(place is not None for place in places):
            plain, own, new = (np.asarray(place) for place in places)
            moves.append((own - plain, new - plain))
    return [(own, new) for own, new in moves if np.hypot(*new) > CLEAR]


def _all_late(make: Make, site: Site, age: float, result: PartResult) -> None:
    scans = [scan._replace(arrival_time=scan.time + age) for scan in site.scans(OBJECTS, FOLLOWED)]
    empty = site.scan(scans[-1].arrival_time, scans[-1].measurement[:, :0], np.random.default_rng(0))
    tracks = MultiObjectSession(make).follow([*scans, empty._replace(asked=True)])[-1]
    behind = []
    for target in moved_objects(OBJECTS, empty.time).T:
        place = _place(tracks, target)
        if place is not None:
            behind.append(float((target[:2] - place) @ target[2:] / (target[2:] @ target[2:])))
    if not behind:
        return
    lag = float(np.median(behind))
    text = (
        f"when all scans arrive {age:g} s after they were taken, the tracks at the time of arrival are {lag:.2g} s of "
        "their motion behind their objects"
    )
    result.note("all_late", lag < BEHIND * age, text, "late_processed_as_new")


def _place(tracks: Tracks, target: Array) -> Array | None:
    column = column_of_nearest(tracks, target)
    return None if column is None else tracks.mean[:2, column]
