"""Weight of a detection against a miss in probabilistic association, by the mean and the covariance of a track.

With one detection in its gate a track goes the share ``b`` of a Kalman filter's step, where ``b / (1 - b)`` is
``Pd N(y; S) / (L (1 - Pd Pg))`` with the detection probability Pd, the likelihood N of the innovation y, the clutter
density L and the gate probability Pg, nearly 1. Two detections on both sides of the predicted one leave the mean as it
is, and the covariance has the spread of the two means (Bar-Shalom, Daum and Huang 2009, equations 38 to 44). With one
detection the covariance is the weighted mean of those after a miss and after an update, plus b (1 - b) times the square
of the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.special import gammaincinv

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.driving.faults import TrackFault
from trackbench.subjects.doctor.findings import KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.traffic import (
    DETECTION,
    OBJECTS,
    FollowedTrack,
    Make,
    Site,
    with_detections,
)
from trackbench.subjects.doctor.traffic_checks.detections import INSIDE

#: Time for which an object is followed, s.
FOLLOWED = 1.0
#: Second stated detection probability; ratio of the odds at 0.9 to those at 0.5, which is 5 with a gate of 0.9; and
#: largest factor, either way, by which the ratio may differ.
OTHER, RATIO, BAND = 0.5, 9.0, 2.5
#: Stated clutter, relative to that with odds of 1, among which one is looked for at which both count; and hardly any.
CLUTTER, NO_CLUTTER = (1.0, 1e-2, 1e2, 1e-4, 1e4, 1e-6, 1e6), 1e-9
#: Changes of the clutter; factors by which the odds may change otherwise, and by which they may be wrong, either way.
CHANGES, CHANGED, SIZE = (10.0, 0.1), 1.5, 3.0
#: Weights from which odds can be computed; those of a tracker that takes a detection or leaves it are outside.
BETWEEN = (0.002, 0.998)
#: Least step without clutter, relative to a Kalman filter's.
LEAST = 0.1
#: Least share of the spread of the means that the covariance has to have.
SPREAD = 0.3
#: Odds at which the spread by one detection is compared, and largest multiple of it that the covariance may have. If
#: the square of the mean's step is not taken off as a whole, the covariance has 1.67 times as much.
ODDS, MOST = 2.0, 1.35
#: Largest step by detections on both sides, relative to the step by one of them, at which both count.
BOTH = 0.2


class WeighedTrack(FollowedTrack):
    """A followed track, and its steps to further detections at the time of its last scan."""

    @cached_property
    def geometry(self) -> tuple[Array, Array, Array]:
        return self.site.expected(self.tracks, self.column)

    @cached_property
    def beside(self) -> Array:
        """Offset ``(m,)`` from the predicted measurement, inside every usual gate.

        Its direction is the first column of the innovation covariance's Cholesky factor.
        """
        return np.asarray(np.sqrt(self.distance) * linalg.cholesky(self.geometry[1]).lower()[:, 0])

    @property
    def distance(self) -> float:
        """Squared length of ``beside``, in units of the innovation's covariance."""
        return float(2 * gammaincinv(len(self.geometry[0]) / 2, INSIDE))

    @cached_property
    def even(self) -> float:
        """Clutter density with which the detection at ``beside`` has odds of 1, the unit of relative clutter."""
        peak = 1 / np.sqrt(np.linalg.det(2 * np.pi * self.geometry[1]))
        return float(DETECTION * peak * np.exp(-self.distance / 2) / (1 - DETECTION))

    def after(self, detections: Sequence[Array], stated_pd: float, density: float) -> tuple[Array, Array] | None:
        """Return mean and covariance after detections at offsets ``(m,)``; None if the track ends or the step fails."""
        expected = self.geometry[0][:, None]
        measured = expected + np.stack(detections, axis=1) if detections else expected[:, :0]
        scan = self.scans[-1]._replace(detection_probability=stated_pd, clutter_density=density)
        try:
            return self.after_scan(with_detections(scan, measured))
        except TrackFault:
            return None

    @cached_property
    def whole(self) -> Array | None:
        """Step ``(4,)`` to the detection at ``beside`` without clutter; None where the track has ended."""
        after = self.after([self.beside], DETECTION, NO_CLUTTER * self.even)
        return None if after is None else after[0] - self.mean

    def share(self, detections: Sequence[Array], stated_pd: float, relative_clutter: float) -> float | None:
        """Return the step by detections at offsets ``(m,)`` as a share of ``whole``; None where the track has ended."""
        after, whole = self.after(detections, stated_pd, relative_clutter * self.even), self.whole
        if after is None or whole is None:
            return None
        return float((after[0] - self.mean)[:2] @ whole[:2] / (whole[:2] @ whole[:2]))

    def odds(self, stated_pd: float, relative_clutter: float, offset: Array | None = None) -> float | None:
        """Return the odds of a detection, by default at ``beside``, against a miss; None unless both have weight."""
        weight = self.share([self.beside if offset is None else offset], stated_pd, relative_clutter)
        if weight is None or not BETWEEN[0] < weight < BETWEEN[1]:
            return None
        return weight / (1 - weight)

    def telling_odds(self) -> tuple[float, float | None]:
        """Return the first relative clutter tried at which detection and miss have weight, and odds; else 0, None."""
        candidates = ((clutter, self.odds(DETECTION, clutter)) for clutter in CLUTTER)
        return next(((clutter, odds) for clutter, odds in candidates if odds is not None), (0.0, None))


@doctor_check(
    Question("weight_of_misses", "Does a detection weigh against a miss as the detection probability says?"),
    Question("weight_of_clutter", "Does a detection weigh against a miss as the stated clutter says?"),
    Question("spread_of_means", "Does the covariance have the spread between several detections?"),
    Question("spread_of_one", "Does the covariance have the spread between a detection and a miss?"),
    place=72,
    faults={
        "pd_misstated": KnownFault(
            "a miss does not count as the sensor's detection probability says",
            "Where the probability of a miss is computed.",
            "Use scan.detection_probability, times the probability of the gate; or return no existence probability.",
            Role(rank=4),
        ),
        "clutter_misstated": KnownFault(
            "a detection does not count as the stated clutter says",
            "Where the likelihood of a detection is divided by the density of false alarms.",
            "Use scan.clutter_density: false alarms per unit volume of the measurement space (m, rad, m/s) and scan.",
            Role(rank=5),
        ),
    },
)
def weights(make: Make, site: Site) -> PartResult:
    """Change the stated detection probability and clutter, give two detections, and compare steps and covariances."""
    result, track = PartResult(), WeighedTrack.of_object(make, site, OBJECTS[:, 0], FOLLOWED)
    if track is None:
        return result
    way = np.hypot(*(track.geometry[2] @ track.beside)[:2])
    if track.whole is None or np.hypot(*track.whole[:2]) < LEAST * way:
        return result
    _check_odds(track, result)
    _check_spread_of_means(track, result)
    _check_spread_of_one(track, result)
    return result


def _check_odds(track: WeighedTrack, result: PartResult) -> None:
    clutter, odds = track.telling_odds()
    if odds is None:
        return
    other_odds = track.odds(OTHER, clutter)
    if other_odds is not None:
        text = (
            f"from a stated detection probability of {OTHER:g} to one of {DETECTION:g} the odds of a detection against "
            f"a miss rise {odds / other_odds:.3g} times, where {RATIO:g} times is right"
        )
        passed = abs(np.log(odds / other_odds / RATIO)) < np.log(BAND)
        result.note("weight_of_misses", bool(passed), text, "pd_misstated")
        if not passed:
            return
    odds_by_change = ((change, track.odds(DETECTION, change * clutter)) for change in CHANGES)
    change, changed = next(((change, odds) for change, odds in odds_by_change if odds is not None), (1.0, None))
    if changed is None:
        return
    text = f"{change:g} times the clutter divides the odds of a detection against a miss by {odds / changed:.3g}"
    passed = abs(np.log(odds / changed / change)) < np.log(CHANGED)
    sideways = track.odds(DETECTION, clutter, track.beside + 2 * linalg.cholesky(track.geometry[1]).lower()[:, -1])
    # A tracker that leaves a component out has a clutter density per volume of the other components.
    if passed and (sideways is None or sideways < 0.5 * odds):
        factor = 1 / (odds * clutter)
        text = f"a detection weighs against a miss as if the clutter were {factor:.3g} times what is stated"
        passed = abs(np.log(factor)) < np.log(SIZE)
    result.note("weight_of_clutter", bool(passed), text, "clutter_misstated")


def _check_spread_of_means(track: WeighedTrack, result: PartResult) -> None:
    both, density = [track.beside, -track.beside], NO_CLUTTER * track.even
    after, centred = track.after(both, DETECTION, density), track.after([0 * track.beside], DETECTION, density)
    share = track.share(both, DETECTION, NO_CLUTTER)
    if after is None or centred is None or share is None or track.whole is None or abs(share) > BOTH:
        return
    along = track.whole / np.linalg.norm(track.whole)
    added = float(along @ (after[1] - centred[1]) @ along) / float(track.whole @ track.whole)
    text = (
        "two detections on both sides of the predicted one leave the mean as it is, and the variance rises "
        f"{added:.3g} times as much as the distance of the two means causes"
    )
    result.note("spread_of_means", added > SPREAD, text, "covariance_update_wrong")


def _check_spread_of_one(track: WeighedTrack, result: PartResult) -> None:
    clutter, odds = track.telling_odds()
    density = clutter * (odds or 0.0) / ODDS
    share = track.share([track.beside], DETECTION, density) if density else None
    missed, sure, after = (
        track.after(detections, DETECTION, relative * track.even)
        for detections, relative in (([], NO_CLUTTER), ([track.beside], NO_CLUTTER), ([track.beside], density))
    )
    if share is None or missed is None or sure is None or after is None or track.whole is None:
        return
    if not 0.5 * ODDS < share / max(1 - share, 1e-12) < 2 * ODDS:
        return
    along = track.whole / np.linalg.norm(track.whole)
    mixed = after[1] - (1 - share) * missed[1] - share * sure[1]
    added = float(along @ mixed @ along) / float(track.whole @ track.whole) / (share * (1 - share))
    text = (
        f"with one detection, whose weight is {share:.2g} against a miss, the variance has {added:.3g} times the "
        "spread of the two means"
    )
    result.note("spread_of_one", SPREAD < added < MOST, text, "covariance_update_wrong")
