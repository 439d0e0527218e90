"""The gate, from whether single detections at known distances are taken."""

from __future__ import annotations

import numpy as np

from trackbench.base import linalg
from trackbench.base.distributions import chi_square_quantile
from trackbench.base.types import Array
from trackbench.subjects.doctor.findings import DoctorCheck, KnownFault, PartResult, Question
from trackbench.subjects.doctor.traffic.scenes import (
    NEAR,
    OBJECTS,
    RATE,
    Follower,
    Make,
    Site,
    distances,
    moved,
    nearest,
    note,
)

#: A detection that no gate should leave out, by its probability, and a squared distance that none should let in.
INSIDE, OUTSIDE = 0.9, 50.0
#: A track takes a detection if it moves by more than this share of a Kalman filter's step towards it.
MOVED = 0.1
#: Time that a track is followed once it is there, and in which it has to come, s.
SETTLED, AWAITED = 0.5, 3.0


def gate(make: Make, site: Site) -> PartResult:
    """One detection at a known distance from where a track expects it."""
    # A small gate loses objects that are fast: from their first detection they are not where a track expects them.
    slow = OBJECTS * np.array([[1], [1], [0.1], [0.1]])
    inside = _steps(make, site, slow, float(chi_square_quantile(INSIDE, site.sensor_size)))
    kept = [step > MOVED for step in inside]
    # A tracker that reckons with more noise than is stated takes shorter steps, and its gate is wider by that.
    own = min(1.0, float(np.median([step for step in inside if step > MOVED]))) if any(kept) else 1.0
    taken = [step > MOVED for step in _steps(make, site, slow, OUTSIDE / own, alone=True)]
    found = PartResult()
    if kept:
        note(
            found, "gate_inside",
            float(np.mean(kept)) > 0.5,
            f"{sum(kept)} of {len(kept)} tracks take one at the {100 * INSIDE:.0f} % point of their innovation",
            "gate_too_small",
        )  # fmt: skip
    if taken:
        note(
            found, "gate_outside",
            float(np.mean(taken)) < 0.5,
            f"{sum(taken)} of {len(taken)} tracks take one {np.sqrt(OUTSIDE):.0f} standard deviations away",
            "gate_too_large",
        )  # fmt: skip
    return found


def _steps(make: Make, site: Site, objects: Array, distance: float, alone: bool = False) -> list[float]:
    """Of each object that has a track: how far one goes towards a detection, over the step of a Kalman filter.

    The detection is at a squared distance, at the time of the last scan. ``alone`` leaves out objects with several
    tracks: what is far from one may be in the wide gate of a younger one.
    """
    steps = (_step(make, site, one, number % 2, distance) for number, one in enumerate(objects.T))
    return [step for step, count in steps if count == 1 or (count > 1 and not alone)]


def _step(make: Make, site: Site, one: Array, component: int, distance: float) -> tuple[float, int]:
    """The longest step of the tracks on an object, and how many there are."""
    follower, left = Follower(make), round(SETTLED * RATE)
    for scan in site.exact(one[:, None], AWAITED):
        tracks = follower.step(scan)
        column = nearest(tracks, moved(one, scan.time))
        left -= column is not None
        if left == 0:
            break
    if column is None:
        return 0.0, 0
    expected = site.expected(tracks, column)
    away = linalg.cholesky(expected.covariance).lower()[:, component] * np.sqrt(distance)
    detection = (expected.mean + away)[:, None]
    after = follower.step(scan._replace(measurement=detection, valid=np.ones(1, dtype=bool)))
    _, before, behind = np.intersect1d(tracks.ids, after.ids, return_indices=True)
    steps = np.hypot(*(after.mean[:2, behind] - tracks.mean[:2, before]))
    count = int((distances(tracks, moved(one, scan.time)[:, None]) < NEAR).sum())
    return float(steps.max(initial=0.0) / np.hypot(*(expected.gain @ away)[:2])), count


CHECKS = (
    DoctorCheck(
        gate,
        place=20,
        questions=(
            Question("gate_outside", "Does a track leave out a detection that cannot be its own?"),
            Question("gate_inside", "Does a track take a detection that is likely to be its own?"),
        ),
        faults={
            "gate_too_small": KnownFault(
                "the gate is too small",
                "Where the squared distance of a detection is held against a threshold.",
                "Take the point of chi-square with as many degrees of freedom as the measurement has, at 0.99 or more.",
                rank=1,
                always=(
                    "double_tracks",
                    "pd_misstated",
                    "clutter_misstated",
                    "confirms_too_late",
                    "confirms_too_soon",
                    "never_deletes",
                    "empty_scan_not_predicted",
                ),
            ),
            "gate_too_large": KnownFault(
                "the gate lets in what cannot be the track's own",
                "Where the squared distance of a detection is held against a threshold.",
                "Gate by the squared distance in units of the innovation's covariance, at 0.9999 of chi-square or "
                "less.",
                rank=6,
                always=("double_tracks", "never_deletes", "ids_reused", "confirms_too_soon"),
            ),
        },
    ),
)
