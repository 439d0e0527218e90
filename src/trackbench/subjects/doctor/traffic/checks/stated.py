"""Whether the stated detection probability and clutter count, from what a scan does to a probability of existence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Scan, Tracks
from trackbench.subjects.doctor.findings import CheckResult, DoctorCheck, KnownFault, PartResult, Question
from trackbench.subjects.doctor.traffic.scenes import DETECTION, OBJECTS, Follower, Make, Site, moved, nearest, note

#: Statements whose misses are compared; at the first a miss says almost nothing.
LITTLE, PROBABILITIES = 0.05, (0.5, DETECTION)
#: Ratio of odds for which a detection is placed, and statements of the clutter that are compared.
RATIO, CLUTTER = 10.0, (1.0, 100.0)
#: How far the tracker's own figures may be from the stated ones: detection probability, and factor of the clutter.
PROBABILITY, FACTOR = 0.1, 1.5
#: Existence this near to 1 is told too coarsely for its odds.
CERTAIN = 1e-10
#: Longest time that the track is followed before, s.
SETTLED = 1.5


def stated_figures(make: Make, site: Site) -> PartResult:
    """What a miss and a detection do to the odds of existence, at no time after the last scan."""
    found = PartResult()
    track = _Track.of_one_object(make, site)
    if track is None:
        return found
    asked = [track.odds(), *(track.odds(track.miss(stated)) for stated in (LITTLE, *PROBABILITIES))]
    told = [odds for odds in asked if odds]
    if len(told) < len(asked):
        found.checks.append(CheckResult("detection_probability", "", None, "one miss ends the track"))
        return found
    before, little = told[:2]
    after = dict(zip(PROBABILITIES, told[2:], strict=True))
    # A tracker to which the statement is all one is held against the odds before; any other against those after a
    # scan that says little, so that what it takes off for the scan or its time does not count.
    heeds = not np.isclose(little, after[DETECTION], rtol=1e-6)
    certain = little / (1 - LITTLE) if heeds else before
    implied = {stated: 1 - odds / certain for stated, odds in after.items()}
    off = max(abs(one - stated) for stated, one in implied.items())
    told_of = " and ".join(f"{one:.2f} where {stated:g} is stated" for stated, one in implied.items())
    said = f"a miss lowers the odds of existence as if the detection probability were {told_of}"
    note(found, "detection_probability", off < PROBABILITY, said, "pd_misstated")
    factors = _clutter_factors(track, certain) if off < PROBABILITY else []
    if factors:
        factor = max(factors, key=lambda one: abs(np.log(one)))
        note(
            found, "clutter",
            abs(np.log(factor)) < np.log(FACTOR),
            f"a detection raises the odds of existence as if the clutter were {factor:.3g} times what is stated",
            "clutter_misstated",
        )  # fmt: skip
    return found


def _clutter_factors(track: _Track, certain: float) -> list[float]:
    """The clutter that the tracker reckons with, over each of the stated ones.

    Only the first over the last of a tracker that does not use all components: its clutter is per volume of others.
    """
    expected = track.site.expected(track.tracks, track.column)
    peak = 1 / np.sqrt(np.linalg.det(2 * np.pi * expected.covariance))

    def rise(measurement: Array, stated: float) -> float | None:
        odds = track.odds(track.hit(measurement, stated))
        return None if odds is None else max(odds / certain - (1 - DETECTION), 1e-12)

    stated = [factor * DETECTION * peak / RATIO for factor in CLUTTER]
    rises = [rise(expected.mean, one) for one in stated]
    last = linalg.cholesky(expected.covariance).lower()[:, -1]
    elsewhere = rise(expected.mean + 2 * last, stated[0])
    if rises[0] is None or rises[1] is None or elsewhere is None:
        return []
    if elsewhere > 0.5 * rises[0]:
        return [CLUTTER[0] / CLUTTER[1] * rises[0] / rises[1]]
    return [DETECTION * peak / one / density for one, density in zip(rises, stated, strict=True)]


@dataclass(frozen=True)
class _Track:
    """The track of one object, with a probability of existence whose odds can be told."""

    make: Make
    site: Site
    scans: list[Scan]
    tracks: Tracks
    column: int

    @classmethod
    def of_one_object(cls, make: Make, site: Site) -> _Track | None:
        """As late as its existence is not certain; None: there is none."""
        scans, follower, found = site.exact(OBJECTS[:, :1], SETTLED), Follower(make), None
        for count, scan in enumerate(scans, start=1):
            tracks = follower.step(scan)
            column = nearest(tracks, moved(OBJECTS[:, 0], scan.time))
            if column is not None and tracks.existence is not None and CERTAIN < 1 - tracks.existence[column] < 1:
                found = cls(make, site, scans[:count], tracks, column)
        return found

    def odds(self, scan: Scan | None = None) -> float | None:
        """After one more scan, if any; None: there is no track any more."""
        tracks = self.tracks
        if scan is not None:
            follower = Follower(self.make)
            follower.follow(self.scans)
            tracks = follower.step(scan)
        column = nearest(tracks, self.tracks.mean[:2, self.column])
        if column is None or tracks.existence is None:
            return None
        return float(tracks.existence[column] / max(1 - tracks.existence[column], np.finfo(float).eps))

    def miss(self, probability: float) -> Scan:
        """A scan without a detection."""
        last = self.scans[-1]
        return last._replace(
            measurement=last.measurement[:, :0], valid=last.valid[:0], detection_probability=probability
        )

    def hit(self, measurement: Array, clutter: float) -> Scan:
        """A scan with one."""
        return self.scans[-1]._replace(measurement=measurement[:, None], clutter_density=clutter)


CHECKS = (
    DoctorCheck(
        stated_figures,
        place=70,
        questions=(
            Question("detection_probability", "Does a miss count as the sensor's detection probability says?"),
            Question("clutter", "Does a detection count as the stated clutter says?"),
        ),
        faults={
            "pd_misstated": KnownFault(
                "a miss does not count as the sensor's detection probability says",
                "Where the probability of a miss is computed.",
                "Use scan.detection_probability, times the probability of the gate; or state no existence, if it is "
                "none.",
                rank=4,
                always=("never_deletes", "double_tracks", "confirms_too_late", "clutter_misstated"),
            ),
            "clutter_misstated": KnownFault(
                "a detection does not count as the stated clutter says",
                "Where the likelihood of a detection is divided by the density of false alarms.",
                "Use scan.clutter_density: false alarms per unit volume of the measurement space (m, rad, m/s) and "
                "scan.",
                rank=5,
                always=("gate_too_large", "confirms_too_soon", "confirms_too_late", "double_tracks"),
            ),
        },
    ),
)
