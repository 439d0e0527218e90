"""What single detections and misses do to a track: its gate, and its probability of existence."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincinv

from trackbench.base import linalg
from trackbench.base.types import Array, Scan
from trackbench.subjects.doctor.findings import CheckResult, KnownFault, PartResult, Question, Role, doctor_check
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

#: A detection that no gate should leave out, by its probability, and a squared distance that none should let in.
INSIDE, OUTSIDE = 0.9, 50.0
#: A track takes a detection if it moves by more than this share of a Kalman filter's step towards it.
MOVED = 0.1
#: Time that a track is followed once it is there, and in which it has to come, s.
SETTLED, AWAITED = 0.5, 3.0
#: Statements of the detection probability whose misses are compared; at the first a miss says almost nothing.
LITTLE, PROBABILITIES = 0.05, (0.5, DETECTION)
#: Ratio of odds for which a detection is placed, and statements of the clutter that are compared.
RATIO, CLUTTER = 10.0, (1.0, 100.0)
#: How far the tracker's own figures may be from the stated ones: detection probability, and factor of the clutter.
PROBABILITY, FACTOR = 0.1, 1.5
#: An existence this near to 1 is reported too coarsely for its odds.
CERTAIN = 1e-10
#: Longest time for which the track is followed before its existence is compared, s.
FOLLOWED = 1.5


@doctor_check(
    Question("gate_outside", "Does a track leave out a detection that cannot be its own?"),
    Question("gate_inside", "Does a track take a detection that is likely to be its own?"),
    place=20,
    faults={
        "gate_too_small": KnownFault(
            "the gate is too small",
            "Where the squared distance of a detection is held against a threshold.",
            "Take the point of chi-square with as many degrees of freedom as the measurement has, at 0.99 or more.",
            Role(rank=1, always="tracks pd_misstated clutter_misstated"),
        ),
        "gate_too_large": KnownFault(
            "the gate lets in what cannot be the track's own",
            "Where the squared distance of a detection is held against a threshold.",
            "Gate by the squared distance in units of the innovation's covariance, at 0.9999 of chi-square or less.",
            Role(rank=6, always="double_tracks never_deletes ids_reused confirms_too_soon"),
        ),
    },
)
def gate_limits(make: Make, site: Site) -> PartResult:
    """One detection at a known distance from where a track expects it."""
    # A small gate loses objects that are fast: from their first detection they are not where a track expects them.
    slow = OBJECTS * np.array([[1], [1], [0.1], [0.1]])
    inside = _steps(make, site, slow, float(2 * gammaincinv(len(site.sensor.components) / 2, INSIDE)))
    kept = [step > MOVED for step in inside]
    # A tracker that reckons with more noise than is stated takes shorter steps, and its gate is wider by that.
    own = min(1.0, float(np.median([step for step in inside if step > MOVED]))) if any(kept) else 1.0
    taken = [step > MOVED for step in _steps(make, site, slow, OUTSIDE / own, alone=True)]
    result = PartResult()
    if kept:
        text = f"{sum(kept)} of {len(kept)} tracks take one at the {100 * INSIDE:.0f} % point of their innovation"
        result.note("gate_inside", float(np.mean(kept)) > 0.5, text, "gate_too_small")
    if taken:
        text = f"{sum(taken)} of {len(taken)} tracks take one {np.sqrt(OUTSIDE):.0f} standard deviations away"
        result.note("gate_outside", float(np.mean(taken)) < 0.5, text, "gate_too_large")
    return result


def _steps(make: Make, site: Site, objects: Array, distance: float, alone: bool = False) -> list[float]:
    """Of each object that has a track: how far one goes towards a detection, over the step of a Kalman filter.

    The detection is at a squared distance, at the time of the last scan. ``alone`` leaves out objects with several
    tracks: what is far from one may be in the wide gate of a younger one.
    """
    steps = (_step(make, site, target, number % 2, distance) for number, target in enumerate(objects.T))
    return [step for step, count in steps if count == 1 or (count > 1 and not alone)]


def _step(make: Make, site: Site, target: Array, component: int, distance: float) -> tuple[float, int]:
    """The longest step of the tracks on an object, and how many there are."""
    session, left = MultiObjectSession(make), round(SETTLED * RATE)
    for scan in site.scans(target[:, None], AWAITED):
        tracks = session.step(scan)
        column = column_of_nearest(tracks, moved_objects(target, scan.time))
        left -= column is not None
        if left == 0:
            break
    if column is None:
        return 0.0, 0
    expected, covariance, gain = site.expected(tracks, column)
    away = linalg.cholesky(covariance).lower()[:, component] * np.sqrt(distance)
    after = session.step(with_detections(scan, (expected + away)[:, None]))
    _, before, behind = np.intersect1d(tracks.ids, after.ids, return_indices=True)
    steps = np.hypot(*(after.mean[:2, behind] - tracks.mean[:2, before]))
    count = int((distances(tracks, moved_objects(target, scan.time)[:, None]) < NEAR).sum())
    return float(steps.max(initial=0.0) / np.hypot(*(gain @ away)[:2])), count


@doctor_check(
    Question("detection_probability", "Does a miss count as the sensor's detection probability says?"),
    Question("clutter", "Does a detection count as the stated clutter says?"),
    place=70,
    faults={
        "pd_misstated": KnownFault(
            "a miss does not count as the sensor's detection probability says",
            "Where the probability of a miss is computed.",
            "Use scan.detection_probability, times the probability of the gate; or state no existence, if it is none.",
            Role(rank=4, always="never_deletes double_tracks confirms_too_late clutter_misstated"),
        ),
        "clutter_misstated": KnownFault(
            "a detection does not count as the stated clutter says",
            "Where the likelihood of a detection is divided by the density of false alarms.",
            "Use scan.clutter_density: false alarms per unit volume of the measurement space (m, rad, m/s) and scan.",
            Role(rank=5, always="gate_too_large confirms_too_soon confirms_too_late double_tracks"),
        ),
    },
)
def stated_figures(make: Make, site: Site) -> PartResult:
    """What a miss and a detection do to the odds of existence, at no time after the last scan."""
    result = PartResult()
    track = _Track.of_one_object(make, site)
    if track is None:
        return result
    last = track.scans[-1]
    empty = with_detections(last, last.measurement[:, :0])
    misses = [empty._replace(detection_probability=stated) for stated in (LITTLE, *PROBABILITIES)]
    odds = [track.odds(), *(track.odds(miss) for miss in misses)]
    positive = [value for value in odds if value]
    if len(positive) < len(odds):
        result.checks.append(CheckResult("detection_probability", "", None, "one miss ends the track"))
        return result
    before, little = positive[:2]
    after = dict(zip(PROBABILITIES, positive[2:], strict=True))
    # A tracker to which the statement is all one is held against the odds before; any other against those after a
    # scan that says little, so that what it takes off for the scan or its time does not count.
    heeds = not np.isclose(little, after[DETECTION], rtol=1e-6)
    certain = little / (1 - LITTLE) if heeds else before
    implied = {stated: 1 - value / certain for stated, value in after.items()}
    off = max(abs(probability - stated) for stated, probability in implied.items())
    each = " and ".join(f"{probability:.2f} where {stated:g} is stated" for stated, probability in implied.items())
    text = f"a miss lowers the odds of existence as if the detection probability were {each}"
    result.note("detection_probability", off < PROBABILITY, text, "pd_misstated")
    factors = _clutter_factors(track, certain) if off < PROBABILITY else []
    if factors:
        factor = max(factors, key=lambda ratio: abs(np.log(ratio)))
        text = f"a detection raises the odds of existence as if the clutter were {factor:.3g} times what is stated"
        result.note("clutter", abs(np.log(factor)) < np.log(FACTOR), text, "clutter_misstated")
    return result


def _clutter_factors(track: _Track, certain: float) -> list[float]:
    """The clutter that the tracker reckons with, over each of the stated ones.

    Only the first over the last of a tracker that does not use all components: its clutter is per volume of others.
    """
    expected, covariance, _ = track.site.expected(track.tracks, track.column)
    peak = 1 / np.sqrt(np.linalg.det(2 * np.pi * covariance))

    def rise(measurement: Array, clutter: float) -> float | None:
        hit = track.scans[-1]._replace(measurement=measurement[:, None], clutter_density=clutter)
        odds = track.odds(hit)
        return None if odds is None else max(odds / certain - (1 - DETECTION), 1e-12)

    stated = [factor * DETECTION * peak / RATIO for factor in CLUTTER]
    rises = [rise(expected, clutter) for clutter in stated]
    elsewhere = rise(expected + 2 * linalg.cholesky(covariance).lower()[:, -1], stated[0])
    if rises[0] is None or rises[1] is None or elsewhere is None:
        return []
    if elsewhere > 0.5 * rises[0]:
        return [CLUTTER[0] / CLUTTER[1] * rises[0] / rises[1]]
    return [DETECTION * peak / ratio / density for ratio, density in zip(rises, stated, strict=True)]


class _Track(FollowedTrack):
    """The track of one object, with a probability of existence whose odds can be computed."""

    @classmethod
    def of_one_object(cls, make: Make, site: Site) -> _Track | None:
        """As late as its existence is not certain; None: there is none."""
        scans, session, track = site.scans(OBJECTS[:, :1], FOLLOWED), MultiObjectSession(make), None
        for count, scan in enumerate(scans, start=1):
            tracks = session.step(scan)
            column = column_of_nearest(tracks, moved_objects(OBJECTS[:, 0], scan.time))
            if column is not None and tracks.existence is not None and CERTAIN < 1 - tracks.existence[column] < 1:
                track = cls(make, site, scans[:count], tracks, column)
        return track

    def odds(self, scan: Scan | None = None) -> float | None:
        """After one more scan, if any; None: there is no track any more."""
        tracks = self.tracks if scan is None else MultiObjectSession(self.make).follow([*self.scans, scan])[-1]
        column = column_of_nearest(tracks, self.mean)
        if column is None or tracks.existence is None:
            return None
        return float(tracks.existence[column] / max(1 - tracks.existence[column], np.finfo(float).eps))
