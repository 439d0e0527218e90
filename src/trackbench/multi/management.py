"""When a track is confirmed, and when it is deleted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from trackbench.trackers.associate import AssociateConfig
from trackbench.types import Array, Mask


class Judged(NamedTuple):
    """What a scan says of each track."""

    hit: Mask
    """``(L,)`` it has a detection."""
    in_view: Mask
    """``(L,)`` it should have one."""
    log_ratio: Array
    """``(L,)`` logarithm of the likelihood that there is an object, over that of false alarms alone."""
    existence: Array | None
    """``(L,)`` probability that the object exists; None where the method has none."""


class TrackLogic(Protocol):
    """A rule on the evidence ``(k, L)`` of tracks."""

    size: ClassVar[int]
    """How many numbers speak for a track."""

    def begun(self, count: int, existence: Array | None) -> Array:
        """``(k, count)`` of tracks that begin with a detection; ``existence`` ``(count,)`` where it is known."""
        ...

    def after_time(self, evidence: Array, survival: float) -> Array:
        """``(k, L)`` after a time in which an object stays with the probability ``survival``."""
        ...

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        """``(k, L)`` after a scan."""
        ...

    def confirms(self, evidence: Array) -> Mask:
        """``(L,)`` which tracks deserve to be reported."""
        ...

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        """``(L,)`` which tracks end."""
        ...


@dataclass(frozen=True)
class CountLogic:
    """M detections in the first N scans confirm; so many misses in a row delete.

    Evidence: detections, scans in view, misses in a row.
    """

    needed: int
    scans: int
    misses: float

    size: ClassVar[int] = 3

    def begun(self, count: int, existence: Array | None) -> Array:
        return np.repeat([[1.0], [1.0], [0.0]], count, axis=1)

    def after_time(self, evidence: Array, survival: float) -> Array:
        return evidence

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        missed = judged.in_view & ~judged.hit
        after: Array = evidence + np.array([judged.hit, judged.in_view, missed])
        after[2, judged.hit] = 0.0
        return after

    def confirms(self, evidence: Array) -> Mask:
        return np.asarray(evidence[0] >= self.needed)

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        lost = evidence[1] - evidence[0] > self.scans - self.needed
        return np.asarray(np.where(confirmed, evidence[2] >= self.misses, lost))


@dataclass(frozen=True)
class ScoreLogic:
    """The log-likelihood ratio of a track confirms it, and deletes it when it falls.

    Source: Blackman and Popoli (1999), "Design and Analysis of Modern Tracking Systems", section 6.2.
    Evidence: the score, 0 at the track's first detection; its largest value.
    """

    threshold: float
    drop: float

    size: ClassVar[int] = 2

    def begun(self, count: int, existence: Array | None) -> Array:
        return np.zeros((2, count))

    def after_time(self, evidence: Array, survival: float) -> Array:
        return evidence

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        score = evidence[0] + judged.log_ratio
        return np.array([score, np.maximum(score, evidence[1])])

    def confirms(self, evidence: Array) -> Mask:
        return np.asarray(evidence[0] >= self.threshold)

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        return np.asarray(evidence[0] <= evidence[1] - self.drop)


@dataclass(frozen=True)
class ExistenceLogic:
    """The probability that the object exists. Evidence: that probability."""

    confirm: float
    delete: float

    size: ClassVar[int] = 1

    def begun(self, count: int, existence: Array | None) -> Array:
        assert existence is not None
        return existence[None]

    def after_time(self, evidence: Array, survival: float) -> Array:
        return evidence * survival

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        assert judged.existence is not None
        return judged.existence[None]

    def confirms(self, evidence: Array) -> Mask:
        return np.asarray(evidence[0] >= self.confirm)

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        return np.asarray(evidence[0] < self.delete)


def track_logic(config: AssociateConfig) -> TrackLogic:
    """The rule that the options describe."""
    if config.method in ("jipda", "pmb"):
        return ExistenceLogic(config.confirm_existence, config.delete_existence)
    if config.confirm == "score":
        return ScoreLogic(config.confirm_score, config.score_drop)
    needed, scans = config.confirm
    return CountLogic(needed, scans, float("inf") if config.delete_misses is None else config.delete_misses)
