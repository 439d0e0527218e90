"""The checks: each plays a scene and names the faults that it shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackbench import linalg
from trackbench.distributions import chi_square_quantile
from trackbench.doctor.findings import CheckResult, Finding, PartResult
from trackbench.doctor.traffic.scenes import DETECTION, OBJECTS, RATE, Follower, Site, distances, moved
from trackbench.stepping.tracks import TracksStepper
from trackbench.types import Array, Scan, Tracks

#: A track this near to an object is on it, m.
NEAR = 5.0
#: Longest time until a track is confirmed whose object every scan detects, and until one without detections ends, s.
LATEST, LONGEST = 1.0, 3.0
#: Share of isolated false alarms that may become tracks.
FALSE_TRACKS = 0.1
#: Share of the time that an object may have two tracks, or none after its first.
TOLERATED = 0.1
#: A detection that no gate should leave out, by its probability, and a squared distance that none should let in.
INSIDE, OUTSIDE = 0.9, 50.0
#: Ratio of odds for which a detection is placed, where the stated clutter is looked at.
RATIO = 10.0
#: How far the tracker's own figures may be from the stated ones: detection probability, and factor of the clutter.
PROBABILITY, FACTOR = 0.1, 1.5

Make = Callable[[], TracksStepper]


def following(make: Make, site: Site) -> PartResult:
    """Three objects far apart, each detected in every scan."""
    random, seconds = np.random.default_rng(1), 8.0
    scans = site.scans(OBJECTS, 0.0, seconds, random)
    answers = Follower(make).follow(scans)
    near = [distances(tracks, moved(OBJECTS, scan.time)) < NEAR for tracks, scan in zip(answers, scans, strict=True)]
    count = np.array([one.sum(axis=0) for one in near])
    first = np.array([np.argmax(own > 0) if own.any() else len(own) for own in count.T])
    waited = float(np.median(first)) / RATE
    twice = float((count > 1).mean())
    found = PartResult()
    _add(
        found, "confirmation", "Is an object that every scan detects soon a track?", waited <= LATEST,
        f"its track is there after {waited:.2f} s", "confirms_too_late",
    )  # fmt: skip
    _add(
        found, "double_tracks", "Has each object one track?", twice <= TOLERATED,
        f"an object has two tracks or more for {100 * twice:.0f} % of the time", "double_tracks",
    )  # fmt: skip
    return found


def gate(make: Make, site: Site) -> PartResult:
    """One detection at a known distance from where a track expects it."""
    kept: list[bool] = []
    taken: list[bool] = []
    for number in range(OBJECTS.shape[1]):
        for distance, outcome in ((chi_square_quantile(INSIDE, site.sensor_size), kept), (OUTSIDE, taken)):
            used = _takes(make, site, number, float(distance))
            if used is not None:
                outcome.append(used)
    found = PartResult()
    if kept:
        share = float(np.mean(kept))
        _add(
            found, "gate_inside", "Does a track take a detection that is likely to be its own?", share > 0.5,
            f"{sum(kept)} of {len(kept)} tracks take one at the {100 * INSIDE:.0f} % point of their innovation",
            "gate_too_small",
        )  # fmt: skip
    if taken:
        share = float(np.mean(taken))
        _add(
            found, "gate_outside", "Does a track leave out a detection that cannot be its own?", share < 0.5,
            f"{sum(taken)} of {len(taken)} tracks take one {np.sqrt(OUTSIDE):.0f} standard deviations away",
            "gate_too_large",
        )  # fmt: skip
    return found


def false_alarms(make: Make, site: Site) -> PartResult:
    """Detections of nothing, one a scan, each at another place."""
    random = np.random.default_rng(3)
    count, angle = 120, 2.399963
    follower, ids = Follower(make), set()
    for k in range(count):
        r = 20 + 120 * ((0.618034 * k) % 1)
        place = np.array([[r * np.cos(angle * k)], [r * np.sin(angle * k)], [0.0], [0.0]])
        ids |= set(follower.step(site.scan(k / RATE, site.detections(place, 0.0, random), random)).ids.tolist())
    found = PartResult()
    _add(
        found, "false_alarms", "Does a single detection make no track?", len(ids) <= FALSE_TRACKS * count,
        f"{len(ids)} tracks of {count} false alarms, each at another place", "confirms_too_soon",
    )  # fmt: skip
    return found


def leaving(make: Make, site: Site) -> PartResult:
    """An object goes; later another one comes."""
    random, stay, away = np.random.default_rng(4), 3.0, 6.0
    follower = Follower(make)
    before = follower.follow(site.scans(OBJECTS[:, :1], 0.0, stay, random))
    gone = follower.follow(site.none(stay, away, random))
    after = follower.follow(site.scans(OBJECTS[:, 1:2], stay + away, stay, random))
    found = PartResult()
    if not any(len(tracks.ids) for tracks in before):
        return found
    there = np.flatnonzero([len(tracks.ids) > 0 for tracks in gone])
    lasted = (there[-1] + 1) / RATE if len(there) else 0.0
    _add(
        found, "deletion", "Does a track end when its object has gone?", lasted <= LONGEST,
        f"it is there for {lasted:.1f} s of {away:g} s without a detection", "never_deletes",
    )  # fmt: skip
    if lasted < away:
        old = {one for tracks in before for one in tracks.ids.tolist()}
        again = old & {one for tracks in after for one in tracks.ids.tolist()}
        _add(
            found, "identities", "Has a new object a new identity?", not again,
            f"of {len(old)} earlier identities {len(again)} come back", "ids_reused",
        )  # fmt: skip
    return found


def order(make: Make, site: Site) -> PartResult:
    """Objects side by side, their detections once as they are listed and once the other way round."""
    apart_by = 4 * site.spread
    objects = np.array([[40.0, 10, -5, 0], [40, 10 + apart_by, -5, 0], [40 + apart_by, 10 + apart_by / 2, -5, 0]]).T
    scans = site.scans(objects, 0.0, 4.0, np.random.default_rng(5))
    turned = [scan._replace(measurement=scan.measurement[:, ::-1]) for scan in scans]
    apart = 0.0
    for one, other in zip(Follower(make).follow(scans), Follower(make).follow(turned), strict=True):
        if len(one.ids) != len(other.ids):
            apart = np.inf
        elif len(one.ids):
            between = distances(one, other.mean)
            apart = max(apart, float(between.min(axis=0).max()), float(between.min(axis=1).max()))
    found = PartResult()
    how = "another number of tracks" if np.isinf(apart) else f"positions up to {apart:.2g} m apart"
    _add(
        found, "order", "Does the order of the detections change nothing?", apart < 1e-6,
        f"the other way round it gives {how}", "order_dependent",
    )  # fmt: skip
    return found


def empty_scan(make: Make, site: Site) -> PartResult:
    """One empty scan, half a second after the last detection."""
    random, settled, gap = np.random.default_rng(6), 3.0, 0.5
    follower = Follower(make)
    last = follower.follow(site.scans(OBJECTS, 0.0, settled, random))[-1]
    found = PartResult()
    if not len(last.ids):
        return found
    time = settled - 1 / RATE + gap
    tracks = follower.step(site.none(time, 1 / RATE, random)[0])
    position = moved(OBJECTS, time)
    speed = np.hypot(*OBJECTS[2:])
    error = distances(tracks, position).min(axis=0) if len(tracks.ids) else np.full(len(speed), np.inf)
    share = float(np.median(error / (gap * speed)))
    _add(
        found, "empty_scan", "Are tracks predicted to an empty scan?", share < 0.5,
        "there are no tracks" if np.isinf(share) else f"after {gap:g} s a track is {share:.2f} of the way behind",
        "empty_scan_not_predicted",
    )  # fmt: skip
    return found


def stated_figures(make: Make, site: Site) -> PartResult:
    """What a miss and a detection do to the probability of existence, at no time after the last scan."""
    missed, odds = [], []
    for probability in (0.5, DETECTION):
        follower, scan, tracks = _settled(make, site, 0)
        if tracks.existence is None or len(tracks.ids) != 1 or not 0 < tracks.existence[0] < 1:
            return PartResult()
        nothing = scan._replace(
            measurement=scan.measurement[:, :0], valid=scan.valid[:0], detection_probability=probability
        )
        after = follower.step(nothing)
        if after.existence is None or len(after.ids) != 1:
            return PartResult()
        missed.append((probability, 1.0 - _odds(after) / _odds(tracks)))
    for factor in (1.0, 100.0):
        follower, scan, tracks = _settled(make, site, 0)
        expected, covariance = _expected(site, tracks, 0)
        peak = 1 / np.sqrt(np.linalg.det(2 * np.pi * covariance))
        stated = factor * DETECTION * peak / RATIO
        one = scan._replace(measurement=expected[:, None], valid=np.ones(1, dtype=bool), clutter_density=stated)
        after = follower.step(one)
        if after.existence is not None and len(after.ids) == 1:
            rise = _odds(after) / _odds(tracks) - (1 - DETECTION)
            odds.append((factor, DETECTION * peak / max(rise, 1e-12) / stated))
    found = PartResult()
    off = max(abs(implied - stated) for stated, implied in missed)
    said = " and ".join(f"{implied:.2f} where {stated:g} is stated" for stated, implied in missed)
    _add(
        found, "detection_probability", "Does a miss count as the sensor's detection probability says?",
        off < PROBABILITY, f"it counts as of {said}", "pd_misstated",
    )  # fmt: skip
    if odds and off < PROBABILITY:
        factor = max((implied for _, implied in odds), key=lambda one: abs(np.log(one)))
        _add(
            found, "clutter", "Does a detection count as the stated clutter says?",
            abs(np.log(factor)) < np.log(FACTOR), f"it counts as at {factor:.3g} times the stated clutter",
            "clutter_misstated",
        )  # fmt: skip
    return found


def _add(result: PartResult, name: str, question: str, passed: bool, said: str, fault: str) -> None:
    result.checks.append(CheckResult(name, question, bool(passed), said))
    if not passed:
        result.findings.append(Finding(fault, 0.9, said[0].upper() + said[1:] + "."))


def _settled(make: Make, site: Site, number: int) -> tuple[Follower, Scan, Tracks]:
    """A tracker after a second of one object, its last scan and what it said."""
    follower = Follower(make)
    scans = site.exact(OBJECTS[:, number : number + 1], 1.5)
    return follower, scans[-1], follower.follow(scans)[-1]


def _expected(site: Site, tracks: Tracks, column: int) -> tuple[Array, Array]:
    """The measurement ``(m,)`` that a track expects, and its covariance with the noise."""
    mean, pose, velocity = tracks.mean[:, column], np.zeros(3), np.zeros(2)
    slope = site.sensor.jacobian(mean, pose, velocity)
    covariance = slope @ tracks.covariance[:, :, column] @ slope.T + site.sensor.noise_covariance()
    return site.sensor.measure(mean, pose, velocity), covariance


def _takes(make: Make, site: Site, number: int, distance: float) -> bool | None:
    """Whether a track is changed by a detection at a squared distance, at the time of the last scan; None: no track."""
    follower, scan, tracks = _settled(make, site, number)
    if len(tracks.ids) != 1:
        return None
    expected, covariance = _expected(site, tracks, 0)
    root = linalg.cholesky(covariance).lower()
    away = expected + root[:, 0] * np.sqrt(distance)
    after = follower.step(scan._replace(measurement=away[:, None], valid=np.ones(1, dtype=bool)))
    column = np.flatnonzero(after.ids == tracks.ids[0])
    if not len(column):
        return False
    return bool(np.hypot(*(after.mean[:2, column[0]] - tracks.mean[:2, 0])) > 1e-6)


def _odds(tracks: Tracks) -> float:
    assert tracks.existence is not None
    return float(tracks.existence[0] / (1 - tracks.existence[0]))
