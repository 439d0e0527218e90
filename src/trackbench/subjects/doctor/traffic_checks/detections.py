"""The gate of a track: which single detections it takes, by their distance from the prediction."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincinv

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.subjects.doctor.findings import KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.traffic import (
    NEAR,
    OBJECTS,
    RATE,
    Make,
    MultiObjectSession,
    Site,
    column_of_nearest,
    distances,
    moved_objects,
    with_detections,
)

#: Probability of a detection that no gate should leave out, and squared distance that no gate should let in.
INSIDE, OUTSIDE = 0.9, 50.0
#: Share of a Kalman filter's step from which on a track has taken a detection.
MOVED = 0.1
#: Time that a track is followed once it is there, and time within which it has to come, s.
SETTLED, AWAITED = 0.5, 3.0


@doctor_check(
    Question("gate_outside", "Does a track leave out a detection that cannot be its own?"),
    Question("gate_inside", "Does a track take a detection that is likely to be its own?"),
    place=20,
    faults={
        "gate_too_small": KnownFault(
            "the gate is too small",
            "Where the squared distance of a detection is compared with a threshold.",
            "Take the point of chi-square with as many degrees of freedom as the measurement has, at 0.99 or more.",
            Role(rank=1),
        ),
        "gate_too_large": KnownFault(
            "the gate lets in detections that cannot be the track's own",
            "Where the squared distance of a detection is compared with a threshold.",
            "Gate by the squared distance in units of the innovation's covariance, at 0.9999 of chi-square or less.",
            Role(rank=6),
        ),
    },
)
def gate_limits(make: Make, site: Site) -> PartResult:
    """Give one detection at a known distance from where a track expects it, and look whether the track takes it."""
    # A small gate loses fast objects: after their first detection they are not where a track expects them.
    slow = OBJECTS * np.array([[1], [1], [0.1], [0.1]])
    inside = _steps(make, site, slow, float(2 * gammaincinv(len(site.sensor.components) / 2, INSIDE)))
    kept = [step > MOVED for step in inside]
    # A tracker that assumes more noise than stated takes shorter steps, and has a wider gate in the same ratio.
    ratio = min(1.0, float(np.median([step for step in inside if step > MOVED]))) if any(kept) else 1.0
    taken = [step > MOVED for step in _steps(make, site, slow, OUTSIDE / ratio, only_single=True)]
    result = PartResult()
    if kept:
        text = f"{sum(kept)} of {len(kept)} tracks take one at the {100 * INSIDE:.0f} % point of their innovation"
        result.note("gate_inside", float(np.mean(kept)) > 0.5, text, "gate_too_small")
    if taken:
        text = f"{sum(taken)} of {len(taken)} tracks take one {np.sqrt(OUTSIDE):.0f} standard deviations away"
        result.note("gate_outside", float(np.mean(taken)) < 0.5, text, "gate_too_large")
    return result


def _steps(make: Make, site: Site, objects: Array, distance: float, only_single: bool = False) -> list[float]:
    """Return how far a track of each object goes towards a detection, relative to a Kalman filter's step.

    ``distance`` is the squared Mahalanobis distance of the detection from the prediction. ``only_single`` leaves out
    objects with several tracks: a detection far from one track may be in the wide gate of a younger track.
    """
    steps = (_step(make, site, target, number % 2, distance) for number, target in enumerate(objects.T))
    return [step for step, count in steps if count == 1 or (count > 1 and not only_single)]


def _step(make: Make, site: Site, target: Array, component: int, distance: float) -> tuple[float, int]:
    """Return the longest step of tracks on an object, relative to a Kalman filter's, and the number of tracks on it."""
    session, remaining = MultiObjectSession(make), round(SETTLED * RATE)
    for scan in site.scans(target[:, None], AWAITED):
        tracks = session.step(scan)
        column = column_of_nearest(tracks, moved_objects(target, scan.time))
        remaining -= column is not None
        if remaining == 0:
            break
    if column is None:
        return 0.0, 0
    expected, covariance, gain = site.expected(tracks, column)
    offset = linalg.cholesky(covariance).lower()[:, component] * np.sqrt(distance)
    after = session.step(with_detections(scan, (expected + offset)[:, None]))
    _, before, behind = np.intersect1d(tracks.ids, after.ids, return_indices=True)
    steps = np.hypot(*(after.mean[:2, behind] - tracks.mean[:2, before]))
    count = int((distances(tracks, moved_objects(target, scan.time)[:, None]) < NEAR).sum())
    return float(steps.max(initial=0.0) / np.hypot(*(gain @ offset)[:2])), count
