"""The gate, from whether single detections at known distances are taken."""

from __future__ import annotations

import numpy as np

from trackbench import linalg
from trackbench.distributions import chi_square_quantile
from trackbench.doctor.findings import PartResult
from trackbench.doctor.traffic.checks import note
from trackbench.doctor.traffic.scenes import OBJECTS, RATE, Follower, Make, Site, moved, nearest
from trackbench.types import Array

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
    kept: list[bool] = []
    taken: list[bool] = []
    for number in range(slow.shape[1]):
        for distance, outcome in ((chi_square_quantile(INSIDE, site.sensor_size), kept), (OUTSIDE, taken)):
            used = _takes(make, site, slow[:, number], number % 2, float(distance))
            if used is not None:
                outcome.append(used)
    found = PartResult()
    if kept:
        note(
            found, "gate_inside", "Does a track take a detection that is likely to be its own?",
            float(np.mean(kept)) > 0.5,
            f"{sum(kept)} of {len(kept)} tracks take one at the {100 * INSIDE:.0f} % point of their innovation",
            "gate_too_small",
        )  # fmt: skip
    if taken:
        note(
            found, "gate_outside", "Does a track leave out a detection that cannot be its own?",
            float(np.mean(taken)) < 0.5,
            f"{sum(taken)} of {len(taken)} tracks take one {np.sqrt(OUTSIDE):.0f} standard deviations away",
            "gate_too_large",
        )  # fmt: skip
    return found


def _takes(make: Make, site: Site, one: Array, component: int, distance: float) -> bool | None:
    """Whether a track moves towards a detection at a squared distance, at the time of the last scan; None: no track."""
    follower, left = Follower(make), round(SETTLED * RATE)
    for scan in site.exact(one[:, None], AWAITED):
        tracks = follower.step(scan)
        column = nearest(tracks, moved(one, scan.time))
        left -= column is not None
        if left == 0:
            break
    if column is None:
        return None
    expected = site.expected(tracks, column)
    away = linalg.cholesky(expected.covariance).lower()[:, component] * np.sqrt(distance)
    detection = (expected.mean + away)[:, None]
    after = follower.step(scan._replace(measurement=detection, valid=np.ones(1, dtype=bool)))
    same = np.flatnonzero(after.ids == tracks.ids[column])
    step = after.mean[:2, same] - tracks.mean[:2, column, None]
    return bool(np.any(np.hypot(*step) > MOVED * np.hypot(*(expected.gain @ away)[:2])))
