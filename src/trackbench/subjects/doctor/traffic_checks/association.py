"""Association: which detection a track takes among those in its gate, and what happens when tracks end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array, Scan, Tracks
from trackbench.subjects.doctor.findings import KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.traffic import (
    DETECTION,
    NEAR,
    OBJECTS,
    RATE,
    FollowedTrack,
    Make,
    MultiObjectSession,
    Site,
    column_of_nearest,
    distances,
    moved_objects,
    with_detections,
)
from trackbench.subjects.doctor.traffic_checks.tracks import LONGEST
from trackbench.subjects.doctor.traffic_checks.weights import NO_CLUTTER, WeighedTrack

#: Time for which objects are followed before a scan is tried, s.
FOLLOWED = 2.0
#: Fast objects, each followed alone: px, py m, vx, vy m/s.
FAST = np.array([[40.0, 5, 10, 2], [30, -30, -3, 12], [-35, 10, 9, -9]]).T
#: Time without a scan, s, in which a fast object goes further than any gate is wide, and no track ends.
GAP = 0.25
#: Distance of the nearer of two detections in a gate, relative to the farther one's; and share of the step to the
#: farther one from which on a track has taken it. A track that counts both the same goes less than 0.6 of it.
NEARER, FARTHER = 0.15, 0.8
#: Share of the way back to its last place from which on a track has taken the detection there.
WENT_BACK = 0.1
#: Two objects one behind the other as seen from the sensor, and their distance, m: some fifteen standard deviations of
#: an innovation, a distance that no gate allows.
QUEUE, APART = np.array([[36.0, 0, -5, 0], [42, 0, -5, 0]]).T, 6.0
#: Share of the step of a Kalman filter from which on a track has taken a detection.
TAKEN = 0.1
#: False alarms of one scan in each period, more than there are tracks; of each other scan; and the period, in scans.
#: Tracks of false alarms end within a period.
MANY, FEW, PERIOD = 12, 1, 6
#: Time for which objects are detected, s. In a count that is not set back, the misses of every fourth scan add up.
DETECTED = 8.0
#: Two objects that leave, and three that stay: px, py m, vx, vy m/s.
LEAVING = np.array([[60.0, 30, -8, 2], [-50, 40, 6, -3]]).T
STAYING = np.array([[20.0, -60, 1, 9], [-30, -40, 5, 5], [70, -20, -9, 0]]).T
EVERY = np.concatenate([LEAVING, STAYING], axis=1)
#: Time until the next objects come, or go, s.
COMES = 1.0
#: Distance of a track behind its object, in periods of the scans, from which on it is not predicted.
BEHIND = 0.25


@doctor_check(
    Question("nearer_of_two", "Does a track prefer the nearer of two detections?"),
    place=11,
    faults={
        "assignment_inverted": KnownFault(
            "a track takes the farthest detection in its gate",
            "Where the assignment is computed: whether it minimises or maximises, and which sum.",
            "linear_sum_assignment minimises the sum: give it distances, or maximize=True with likelihoods.",
            Role(rank=0),
        )
    },
)
def nearer_of_two(make: Make, site: Site) -> PartResult:
    """Give a track a near and a far detection in its gate, on either side and in both orders, and compare its steps."""
    track = WeighedTrack.of_object(make, site, OBJECTS[:, 0], FOLLOWED)
    if track is None or len(track.tracks.ids) != 1:
        return PartResult()
    taken = []
    for side in (1, -1):
        far, near = side * track.beside, side * NEARER * track.beside
        for detections in ([near, far], [far, near]):
            share = track.share(detections, DETECTION, NO_CLUTTER)
            if share is None:
                return PartResult()
            taken.append(side * share)
    text = (
        f"of two detections in its gate, one {1 / NEARER:.2g} times as far away as the other, a track goes at least "
        f"{min(taken):.0%} of the step that the farther one alone causes, on both sides and in both orders"
    )
    return PartResult().note("nearer_of_two", not min(taken) > FARTHER, text, "assignment_inverted")


@doctor_check(
    Question("predicted_place", "Does a track take the detection where it is predicted to be?"),
    place=12,
    faults={
        "associated_unpredicted": KnownFault(
            "detections are compared with tracks that are not predicted",
            "Where the distance of detections from tracks is computed, and where tracks are predicted.",
            "Predict all tracks to scan.time first, mean and covariance; then compute the distances.",
            Role(rank=0),
        )
    },
)
def predicted_place(make: Make, site: Site) -> PartResult:
    """Give a detection where a fast object is predicted and one where it was, after a moment without a scan."""
    shares = [share for target in FAST.T if (share := _share_of_way_back(make, site, target)) is not None]
    if not shares:
        return PartResult()
    back = sum(share > WENT_BACK for share in shares)
    text = (
        f"{GAP:g} s after the last scan, {back} of {len(shares)} tracks take a detection where they were and leave the "
        "one where they are predicted to be"
    )
    return PartResult().note("predicted_place", 2 * back <= len(shares), text, "associated_unpredicted")


def _share_of_way_back(make: Make, site: Site, target: Array) -> float | None:
    """Return how far a track goes back from its predicted to its last place, as a share; None if it has ended."""
    track = FollowedTrack.of_object(make, site, target, FOLLOWED)
    if track is None:
        return None
    time, random = track.scans[-1].time + GAP, np.random.default_rng(0)
    missed = track.after_scan(site.scan(time, site.detections(target[:, None])[:, :0], random))
    if missed is None:
        return None
    predicted, _ = missed
    both = site.detections(np.stack([predicted, track.mean], axis=1))
    after, way = track.after_scan(site.scan(time, both, random)), track.mean[:2] - predicted[:2]
    if after is None or np.hypot(*way) < 0.5 * GAP * np.hypot(*target[2:]):
        return None
    return float((after[0] - predicted)[:2] @ way / (way @ way))


@doctor_check(
    Question("allowed_pair", "Does a track keep its detection when another one is outside all gates?"),
    place=22,
    faults={
        "gated_after_assignment": KnownFault(
            "pairs that the gate does not allow take part in the assignment",
            "Where the costs of the assignment are computed, and where pairs beyond the gate are dropped.",
            "Give pairs beyond the gate one high cost before the assignment; drop such pairs after it.",
            Role(rank=1),
        )
    },
)
def allowed_pair(make: Make, site: Site) -> PartResult:
    """Give two detections to two tracks; the gates allow one of the four pairs.

    Along a line the tracks are at 0 and d, the detections at s and s - d. Here s is one standard deviation of an
    innovation. The sum of squared distances is least with the two pairs that are not allowed, each d - s apart. In the
    assignment with the allowed pair, the other pair is 2 d - s apart.
    """
    scans = site.scans(QUEUE, FOLLOWED)
    tracks = MultiObjectSession(make).follow(scans)[-1]
    columns = [column_of_nearest(tracks, moved_objects(target, scans[-1].time)) for target in QUEUE.T]
    if columns[0] is None or columns[1] is None or len(tracks.ids) != 2:
        return PartResult()
    expected, covariance, gain = site.expected(tracks, columns[0])
    offset = np.zeros(len(expected))
    offset[0] = np.sqrt(covariance[0, 0])
    second = expected - offset
    second[0] -= APART - 2 * offset[0]
    step = float(np.hypot(*(gain @ offset)[:2]))
    track = FollowedTrack(make, site, scans, tracks, columns[0])
    pairs = ([expected + offset], [expected + offset, second])
    alone, both = (_distance_moved(track, detections) / step for detections in pairs)
    if alone < TAKEN:
        return PartResult()
    text = (
        f"a track goes {alone:.0%} of a Kalman filter's step towards a detection one standard deviation away, and "
        f"{both:.0%} of it where a second detection is {APART:g} m from all tracks"
    )
    return PartResult().note("allowed_pair", both > TAKEN, text, "gated_after_assignment")


def _distance_moved(track: FollowedTrack, detections: Sequence[Array]) -> float:
    after = track.after_scan(with_detections(track.scans[-1], np.stack(detections, axis=1)))
    return 0.0 if after is None else float(np.hypot(*(after[0] - track.mean)[:2]))


@doctor_check(Question("deletion.among_others", "Does a track end when all detections are elsewhere?"), place=42)
def missed_among_others(make: Make, site: Site) -> PartResult:
    """Let an object go, while every scan has false alarms elsewhere, and count how long its track stays."""
    random, target = np.random.default_rng(6), np.array([30.0, 20, 2, 3])
    session = MultiObjectSession(make)
    scans = site.scans(target[:, None], FOLLOWED, random)
    tracks = session.follow(scans)[-1]
    if column_of_nearest(tracks, moved_objects(target, scans[-1].time)) is None:
        return PartResult()
    lasted, count, number = 0, round((LONGEST + 0.5) * RATE), 0
    for k in range(count):
        time, numbers = scans[-1].time + (k + 1) / RATE, number + np.arange(FEW if k % PERIOD else MANY)
        number += len(numbers)
        # False alarms are spread evenly behind the sensor.
        angle, r = np.pi * (0.9 + 0.9 * ((0.754878 * numbers) % 1)), 60 + 80 * ((0.569840 * numbers) % 1)
        places = np.array([r * np.cos(angle), r * np.sin(angle), 0 * r, 0 * r])
        tracks = session.step(site.scan(time, site.detections(places, 0.0, random), random))
        lasted += bool((distances(tracks, moved_objects(target, time)[:2, None]) < 4 * NEAR).any())
    text = f"it is there for {lasted / RATE:.1f} s of {count / RATE:g} s in which all detections are elsewhere"
    return PartResult().note("deletion.among_others", lasted / RATE <= LONGEST, text, "never_deletes")


@doctor_check(
    Question("ended_alone", "When tracks end, do the others stay?"),
    Question("predicted_alone", "When tracks end, are the others predicted?"),
    place=44,
    faults={
        "wrong_track_deleted": KnownFault(
            "a track is deleted although its object is detected",
            "Where tracks are removed from their list, and where their missed scans are counted.",
            "Make a new list: tracks = [track for track in tracks if not lost(track)]; an index is wrong "
            "once an earlier track has been removed. A detection sets the count of missed scans back to 0.",
            Role(rank=6),
        )
    },
)
def ended_alone(make: Make, site: Site) -> PartResult:
    """Let two objects go at once and three stay, and look whether the tracks of the three go on."""
    session, (come, stay) = MultiObjectSession(make), _ending(site, np.random.default_rng(7))
    before = session.follow(come)[-1]
    if any(column_of_nearest(before, target) is None for target in moved_objects(EVERY, come[-1].time).T):
        return PartResult()
    lost = np.zeros(STAYING.shape[1], dtype=bool)
    for scan in stay:
        tracks = session.step(scan)
        lost |= [column_of_nearest(tracks, target) is None for target in moved_objects(STAYING, scan.time).T]
    text = f"of {len(lost)} objects that every scan detects, {sum(lost)} lose their tracks after two others have gone"
    result = PartResult().note("ended_alone", not lost.any(), text, "wrong_track_deleted")
    return result if lost.any() else _predicted_alone(make, site, result)


def _ending(site: Site, random: np.random.Generator | None) -> tuple[list[Scan], list[Scan]]:
    """Return the scans until two of five objects go, and the scans of the three that stay."""
    come = [*site.scans(LEAVING, COMES, random), *site.scans(EVERY, COMES, random, start=COMES)]
    return come, site.scans(STAYING, LONGEST + 0.5, random, start=2 * COMES)


def _predicted_alone(make: Make, site: Site, result: PartResult) -> PartResult:
    """Check the tracks that stay without noise: nothing but a missing prediction puts them behind their objects."""
    session, (come, stay) = MultiObjectSession(make), _ending(site, None)
    session.follow(come[:-1])
    before, *after = [_behind(session.step(scan), moved_objects(STAYING, scan.time)) for scan in [come[-1], *stay]]
    if before > BEHIND / 2:
        return result
    text = f"a track is behind its object by {max(after):.2g} of the time between two scans after others have ended"
    return result.note("predicted_alone", max(after) < BEHIND, text, "associated_unpredicted")


def _behind(tracks: Tracks, targets: Array) -> float:
    """Return the largest distance of a track ahead of or behind its object along the path, in periods of the scans."""
    if not len(tracks.ids):
        return np.inf
    difference = targets - tracks.mean[:, distances(tracks, targets[:2]).argmin(axis=0)]
    return float(np.abs(np.sum(difference[:2] * targets[2:], axis=0) / np.sum(targets[2:] ** 2, axis=0)).max() * RATE)


@doctor_check(Question("ended_detected", "Does a track stay while its object is detected?"), place=43)
def ended_detected(make: Make, site: Site) -> PartResult:
    """Detect three objects in three of four scans, the fourth being empty, and look whether their tracks stay."""
    session, random = MultiObjectSession(make), np.random.default_rng(9)
    lost, had = (np.zeros(STAYING.shape[1], dtype=bool) for _ in range(2))
    for k, scan in enumerate(site.scans(STAYING, DETECTED, random)):
        tracks = session.step(with_detections(scan, scan.measurement[:, :0]) if k % 4 == 3 else scan)
        present = np.array(
            [column_of_nearest(tracks, target) is not None for target in moved_objects(STAYING, scan.time).T]
        )
        lost, had = lost | (had & ~present), had | present
    if not had.all():
        return PartResult()
    text = f"of {len(lost)} objects that three of four scans detect for {DETECTED:g} s, {sum(lost)} lose their tracks"
    return PartResult().note("ended_detected", not lost.any(), text, "wrong_track_deleted")
