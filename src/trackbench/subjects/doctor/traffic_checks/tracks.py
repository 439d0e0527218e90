"""Begin, end and identity of tracks, and the effect of the order of detections and of empty scans on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array, Mask, Scan, Tracks
from trackbench.subjects.doctor.findings import KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.traffic import (
    NEAR,
    OBJECTS,
    RATE,
    Make,
    MultiObjectSession,
    Site,
    distances,
    moved_objects,
)

#: Longest time until the track of an object in every scan is confirmed, and until a track without detections ends, s.
LATEST, LONGEST = 1.0, 3.0
#: Largest share of isolated false alarms that may become tracks.
FALSE_TRACKS = 0.1
#: Largest share of the time in which the median object may have two tracks.
TOLERATED = 0.1
#: Pairs of objects that meet around the sensor: number of pairs; their range, m; time at which they meet, s; speed at
#: which they come together, m/s; and distance in passing, in standard deviations of a position.
PAIRS, AWAY, MEET, TOGETHER, PASSING = 5, 40.0, 2.0, 10.0, 0.5
#: Distance of a third object beside one of each pair, m, within the gates of new tracks; seeds of noise and orders.
NEXT, DRAWS = 2.0, (5, 6, 7)
#: Number of empty scans in a row in which predictions are looked at, and number of objects that come at once.
EMPTY, COMING = 3, 8


@doctor_check(
    Question("double_tracks", "Does each object have one track?"),
    Question("confirmation", "Is an object that every scan detects soon a track?"),
    place=10,
    faults={
        "confirms_too_late": KnownFault(
            "tracks are confirmed too late",
            "Where a tentative track becomes a confirmed one.",
            "Ask for fewer detections (3 of 5), or for a lower score or probability of existence (0.95).",
        ),
        "double_tracks": KnownFault(
            "an object has two tracks",
            "Where a detection starts a new track.",
            "Let only those detections start one that no track is likely to have caused, and merge tracks that "
            "coincide.",
            Role(rank=8),
        ),
    },
)
def following(make: Make, site: Site) -> PartResult:
    """Detect three objects far apart in every scan, and count the tracks on each of them over time."""
    scans = site.scans(OBJECTS, 3.0, np.random.default_rng(1))
    count = _count_on_objects(MultiObjectSession(make).follow(scans), scans)
    first = np.array([np.argmax(counts > 0) if counts.any() else len(counts) for counts in count.T])
    waited, never = float(np.median(first)) / RATE, bool(np.median(first) == len(scans))
    text = f"the object has no track in {waited:g} s" if never else f"its track is there after {waited:.2f} s"
    result = PartResult().note("confirmation", waited <= LATEST, text, "confirms_too_late")
    return _single_tracks(result, "double_tracks", count)


@doctor_check(
    Question("false_alarms", "Does a single detection make no track?"),
    place=30,
    faults={
        "confirms_too_soon": KnownFault(
            "tracks are confirmed too soon",
            "Where a tentative track becomes a confirmed one.",
            "A single detection is no track: ask for 3 of 5, or for a score or an existence probability that clutter "
            "does not reach.",
            Role(rank=9),
        )
    },
)
def tracks_of_false_alarms(make: Make, site: Site) -> PartResult:
    """Give one false alarm a scan, each at a different place, and count the tracks that they make."""
    random = np.random.default_rng(3)
    count, angle = 120, 2.399963
    session, ids = MultiObjectSession(make), set()
    for k in range(count):
        r = 20 + 120 * ((0.618034 * k) % 1)
        place = np.array([[r * np.cos(angle * k)], [r * np.sin(angle * k)], [0.0], [0.0]])
        ids |= set(session.step(site.scan(k / RATE, site.detections(place, 0.0, random), random)).ids.tolist())
    text = f"{len(ids)} tracks of {count} false alarms, each at another place"
    return PartResult().note("false_alarms", len(ids) <= FALSE_TRACKS * count, text, "confirms_too_soon")


@doctor_check(
    Question("identities", "Does a new object get a new identity?"),
    Question("deletion", "Does a track end when its object has gone?"),
    place=40,
    faults={
        "never_deletes": KnownFault(
            "tracks are not deleted",
            "Where a track without detections is looked at.",
            "Delete a track after about a second in view without a detection, or when its existence probability has "
            "become small.",
            Role(rank=7),
        ),
        "ids_reused": KnownFault(
            "identities are used again",
            "Where a new track gets its id.",
            "Count up through the whole run; do not number the tracks by their place in the list.",
        ),
    },
)
def leaving(make: Make, site: Site) -> PartResult:
    """Let one of three objects go, then the two others, and twice let eight new objects come elsewhere."""
    random, stay_s, away_s = np.random.default_rng(4), 2.0, LONGEST + 0.5
    session, result = MultiObjectSession(make), PartResult()
    before = session.follow(site.scans(OBJECTS, stay_s, random))[-1]
    if not len(before.ids):
        return result
    remaining = site.scans(moved_objects(OBJECTS[:, 1:], stay_s), away_s, random, origin=stay_s)
    fewer = session.follow(remaining)
    stale = [
        (~_on(tracks, moved_objects(OBJECTS[:, 1:], scan.time))).any()
        for tracks, scan in zip(fewer, remaining, strict=True)
    ]
    none = _step_until_no_tracks(session, site.scans(OBJECTS[:, :0], away_s, random, start=stay_s + away_s))
    lasted = [sum(stale) / RATE, sum(len(tracks.ids) > 0 for tracks in none) / RATE]
    text = (
        f"it is there for {lasted[0]:.1f} s of {away_s:g} s without a detection while others are detected, "
        f"and for {lasted[1]:.1f} s of {away_s:g} s of empty scans"
    )
    result.note("deletion", max(lasted) <= LONGEST, text, "never_deletes")
    earlier = {track for tracks in (before, *fewer) for track in tracks.ids.tolist()} - set(none[-1].ids.tolist())
    reused, count, time = 0, 0, stay_s + 2 * away_s
    for turn in (0.0, 0.4):
        angle = turn + 2 * np.pi * np.arange(COMING) / COMING
        ring = np.array([70 * np.cos(angle), 70 * np.sin(angle), 5 * np.cos(angle), 5 * np.sin(angle)])
        wave = session.follow(site.scans(ring, LATEST, random, origin=time))
        gone = _step_until_no_tracks(session, site.scans(OBJECTS[:, :0], away_s, random, start=time + LATEST))
        ids = {track for tracks in wave for track in tracks.ids[_on(tracks, moved_objects(ring, LATEST / 2))].tolist()}
        reused, count = reused + len(ids & earlier), count + len(ids)
        earlier, time = (earlier | ids) - set(gone[-1].ids.tolist()), time + LATEST + away_s
    if count:
        text = f"of the identities of {count} new tracks {reused} were those of earlier ones"
        result.note("identities", not reused, text, "ids_reused")
    return result


@doctor_check(
    Question("order", "Are the tracks the same for any order of the detections?"),
    place=50,
    faults={
        "order_dependent": KnownFault(
            "the order of the detections changes the tracks",
            "Where detections are assigned to tracks one after the other.",
            "Assign all of a scan at once (scipy.optimize.linear_sum_assignment), or by marginal probabilities.",
            Role(rank=2),
        )
    },
)
def order(make: Make, site: Site) -> PartResult:
    """Give the detections of objects that meet in pairs, in two random orders, and compare the tracks."""
    objects, changed = _meeting(site), ""
    # Several draws: the order may decide which of two assignments with almost the same cost is taken.
    for seed in DRAWS:
        random = np.random.default_rng(seed)
        scans = site.scans(objects, 1.5 * MEET, random)
        # Both orders are random: in a reversed one, a track that takes the detection in its own column might not show.
        mixed = [site.scan(scan.time, scan.measurement, random) for scan in scans]
        changed = _difference(MultiObjectSession(make).follow(scans), MultiObjectSession(make).follow(mixed))
        if not changed:
            break
    text = f"the same detections in another order give {changed or 'the same tracks'}"
    return PartResult().note("order", not changed, text, "order_dependent")


def _meeting(site: Site) -> Array:
    """Return objects ``(4, n)`` at time 0 around the sensor: pairs that will meet, and a third one beside each pair."""
    detection = site.scan(0.0, site.detections(np.array([[AWAY], [0], [0], [0]])), np.random.default_rng(0))
    sigma = np.sqrt(np.linalg.eigvalsh(site.sensor.position(detection).covariance.reshape(2, 2)).max())
    angle = 2 * np.pi * np.arange(PAIRS) / PAIRS
    out, velocity = np.array([np.cos(angle), np.sin(angle)]), TOGETHER / 2 * np.array([-np.sin(angle), np.cos(angle)])
    ranges = AWAY + PASSING * sigma * np.array([0.5, -0.5, 0.5]) + np.array([0, 0, NEXT])
    met = [np.concatenate([range_m * out, sign * velocity]) for range_m, sign in zip(ranges, (1, -1, 1), strict=True)]
    return moved_objects(np.concatenate(met, axis=1), -MEET)


def _difference(answers: Sequence[Tracks], reordered: Sequence[Tracks]) -> str:
    """Describe how two runs' tracks of the same detections differ in number or position; empty where they agree."""
    for tracks, other in zip(answers, reordered, strict=True):
        if len(tracks.ids) != len(other.ids):
            return f"{len(other.ids)} tracks in place of {len(tracks.ids)}"
        if not len(tracks.ids):
            continue
        between = distances(tracks, other.mean)
        distance = max(float(between.min(axis=0).max()), float(between.min(axis=1).max()))
        if not distance < 1e-6:
            return f"positions {distance:.2g} m apart"
    return ""


@doctor_check(
    Question("empty_scan", "Are tracks predicted to an empty scan?"),
    place=60,
    faults={
        "empty_scan_not_predicted": KnownFault(
            "tracks are not predicted to an empty scan",
            "Where a scan without detections returns early.",
            "Predict at every scan, empty ones too, and count the miss.",
            Role(rank=3),
        )
    },
)
def tracks_at_empty_scans(make: Make, site: Site) -> PartResult:
    """Give a few empty scans after objects that every scan detected, and look whether the tracks move on."""
    session = MultiObjectSession(make)
    scans = site.scans(OBJECTS, 2.0)
    last = session.follow(scans)[-1]
    if not len(last.ids):
        return PartResult()
    worst, text = -1.0, "at empty scans there are no tracks"
    for scan in site.scans(OBJECTS[:, :0], EMPTY / RATE, start=scans[-1].time + 1 / RATE):
        tracks, elapsed = session.step(scan), scan.time - scans[-1].time
        if not len(tracks.ids):
            continue
        # The tracks' own velocities say without an error where the tracks should be.
        error = distances(tracks, moved_objects(last.mean, elapsed)).min(axis=0)
        way = elapsed * np.hypot(*last.mean[2:])
        share = float(np.median(error / way))
        if worst < 0.0:
            worst, text = 0.0, "they are where their own velocities take them"
        if share > worst:
            worst = share
            text = (
                f"at an empty scan {elapsed:.2g} s after the last detection a track that moves {np.median(way):.2g} m "
                f"in this time is {np.median(error):.2g} m from where it should be"
            )
    return PartResult().note("empty_scan", 0.0 <= worst < 0.5, text, "empty_scan_not_predicted")


def _single_tracks(result: PartResult, name: str, count: Array) -> PartResult:
    """Check that each object has one track; ``count`` ``(scans, objects)`` is its number of tracks."""
    # The median object counts: a second track of one may come of a single outlying detection.
    twice = float(np.median((count > 1).mean(axis=0)))
    text = f"an object has two tracks or more for {100 * twice:.0f} % of the time"
    return result.note(name, twice <= TOLERATED, text, "double_tracks")


def _count_on_objects(answers: Sequence[Tracks], scans: Sequence[Scan]) -> Array:
    near = [
        distances(tracks, moved_objects(OBJECTS, scan.time)) < NEAR for tracks, scan in zip(answers, scans, strict=True)
    ]
    return np.array([tracks.sum(axis=0) for tracks in near])


def _on(tracks: Tracks, objects: Array) -> Mask:
    """Return for each of K tracks whether it is on any of the objects, ``(K,)``."""
    return np.asarray((distances(tracks, objects) < NEAR).any(axis=1))


def _step_until_no_tracks(session: MultiObjectSession, scans: Sequence[Scan]) -> list[Tracks]:
    answers: list[Tracks] = []
    for scan in scans:
        answers.append(session.step(scan))
        if not len(answers[-1].ids):
            break
    return answers
