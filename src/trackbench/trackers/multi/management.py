"""When a track begins, when it is confirmed, and when it is deleted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices, Mask, indices
from trackbench.engine.equations import Compute, Equations, Values
from trackbench.trackers.associate import COUNTING, EXISTENCE, AssociateConfig
from trackbench.trackers.initial import SAME_TIME
from trackbench.trackers.multi.association import CLAIMED, Association, AssociationInput
from trackbench.trackers.multi.table import NONE, TrackFilter, TrackTable, empty, selected_detections


class Judged(NamedTuple):
    """Evidence of a scan for each track."""

    hit: Mask
    """``(L,)`` it has a detection."""
    in_view: Mask
    """``(L,)`` it should have one."""
    log_ratio: Array
    """``(L,)`` logarithm of the likelihood that there is an object, over that of false alarms alone."""
    existence: Array | None
    """``(2, L)`` probability that the object exists, and that it is not hidden if so; None where it is not asked."""


class _Untimed:
    """The evidence does not change with time alone."""

    def after_time(self, evidence: Array, elapsed: float) -> Array:
        return evidence


@dataclass(frozen=True)
class CountLogic(_Untimed):
    """M detections in the first N scans confirm; a track that can no longer have them is deleted.

    Evidence: detections, scans in view.
    """

    needed: int
    scans: int

    size: ClassVar[int] = 2

    def begun(self, count: int, existence: Array | None) -> Array:
        return np.ones((2, count))

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        return linalg.vector([evidence[0] + judged.hit, evidence[1] + judged.in_view])

    def confirms(self, evidence: Array) -> Mask:
        result: Mask = evidence[0] >= self.needed
        return result

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        result: Mask = ~confirmed & (evidence[1] - evidence[0] > self.scans - self.needed)
        return result


@dataclass(frozen=True)
class ScoreLogic(_Untimed):
    """The log-likelihood ratio of a track confirms it, and deletes it when it falls.

    Source: Blackman and Popoli (1999), "Design and Analysis of Modern Tracking Systems", section 6.2.
    Evidence: the score, 0 at the track's first detection; its largest value.
    """

    threshold: float
    drop: float

    size: ClassVar[int] = 2

    def begun(self, count: int, existence: Array | None) -> Array:
        return np.zeros((2, count))

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        score = evidence[0] + judged.log_ratio
        return linalg.vector([score, np.maximum(score, evidence[1])])

    def confirms(self, evidence: Array) -> Mask:
        result: Mask = evidence[0] >= self.threshold
        return result

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        result: Mask = evidence[0] <= evidence[1] - self.drop
        return result


@dataclass(frozen=True)
class ExistenceLogic:
    """The probability that the object exists.

    An object that exists is at times hidden from the sensors. Source: Musicki, Evans and Stankovic (1994), "Integrated
    probabilistic data association", Markov chain two. Evidence: the probability that it exists; that it is not hidden
    if it does.
    """

    confirm: float
    delete: float
    """Below this a track is deleted."""
    lifetime: float
    """Mean, s."""
    hides: float
    """Rate at which visible objects hide, 1/s."""
    returns: float
    """Rate at which hidden ones come back, 1/s."""

    size: ClassVar[int] = 2

    def begun(self, count: int, existence: Array | None) -> Array:
        assert existence is not None
        return np.array([existence, np.ones(count)])

    def after_time(self, evidence: Array, elapsed: float) -> Array:
        rate = self.hides + self.returns
        at_last = self.returns / rate
        visible = at_last + (evidence[1] - at_last) * np.exp(-rate * elapsed)
        return np.array([evidence[0] * np.exp(-elapsed / self.lifetime), visible])

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        assert judged.existence is not None
        return judged.existence

    def confirms(self, evidence: Array) -> Mask:
        result: Mask = evidence[0] >= self.confirm
        return result

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        result: Mask = evidence[0] < self.delete
        return result


@dataclass(frozen=True)
class CountedExistence:
    """Detections are counted to confirm a track; the probability that its object exists deletes it.

    Evidence: that of existence, then that of counting.
    """

    existence: ExistenceLogic
    count: CountLogic

    size: ClassVar[int] = ExistenceLogic.size + CountLogic.size

    def begun(self, count: int, existence: Array | None) -> Array:
        return np.concatenate([self.existence.begun(count, existence), self.count.begun(count, None)])

    def after_time(self, evidence: Array, elapsed: float) -> Array:
        return np.concatenate([self.existence.after_time(evidence[:2], elapsed), evidence[2:]])

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        existence, counted = judged.existence, self.count.after_scan(self._counted(evidence), judged)
        assert existence is not None
        return linalg.vector([existence[0], existence[1], counted[0], counted[1]])

    def confirms(self, evidence: Array) -> Mask:
        return self.count.confirms(self._counted(evidence))

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        exists = self.existence.deletes(evidence, confirmed)
        result: Mask = exists | self.count.deletes(self._counted(evidence), confirmed)
        return result

    def _counted(self, evidence: Array) -> Array:
        return linalg.vector([evidence[2], evidence[3]])


#: A rule on the evidence ``(k, L)`` of tracks, where k is ``size``. ``begun`` gives that of tracks that begin with a
#: detection; ``after_time`` and ``after_scan`` move it on; ``confirms`` tells which tracks get an id, and
#: ``deletes`` which end, each ``(L,)``.
TrackLogic = CountLogic | ScoreLogic | ExistenceLogic | CountedExistence


#: Score at which ``confirm: score`` confirms a track, and how far below its largest it deletes it.
CONFIRMING_SCORE, SCORE_DROP = 12.0, 10.0
#: Mean time for which a hidden object stays so, s.
HIDDEN_S = 1.0


def track_logic(config: AssociateConfig) -> TrackLogic:
    """The rule that the options describe."""
    rule = config.confirms_by
    if rule == "score":
        return ScoreLogic(CONFIRMING_SCORE, SCORE_DROP)
    hides = 0.0 if config.visible_s is None else 1.0 / config.visible_s
    limits = config.report_limits[0], config.delete_existence
    existence = ExistenceLogic(*limits, config.lifetime_s, hides, 1.0 / HIDDEN_S)
    if rule == "existence":
        return existence
    counting = CountLogic(*rule)
    return CountedExistence(existence, counting) if config.method in EXISTENCE else counting


@cache
def judgement(logic: TrackLogic, silent_s: float, existence: bool) -> Equations:
    """The evidence after a scan, the time of the latest detection, and which tracks end.

    A track ends too once its latest detection is longer ago than ``silent_s``. ``existence``: whether it is known.
    """

    def function(values: Values) -> Values:
        hit = values["hit"]
        in_view = hit | (values["detection probability"] > 0.0)
        judged = Judged(hit, in_view, values["log ratio"], values["existence"] if existence else None)
        evidence = logic.after_scan(values["evidence"], judged)
        seen = np.where(hit, values["time"], values["seen"])
        ends = logic.deletes(evidence, values["confirmed"]) | (values["time"] - seen > silent_s)
        return {"evidence": evidence, "seen": seen, "ends": ends}

    ranks = dict.fromkeys(("hit", "detection probability", "log ratio", "seen", "confirmed", "time"), 0)
    ranks |= {"evidence": 1} | ({"existence": 1} if existence else {})
    return Equations("evidence of tracks", function, ranks, key=(logic, silent_s))


@dataclass(frozen=True)
class TrackManager:
    """Tells which tracks end and which begin after the detections of a scan are associated."""

    associate: AssociateConfig
    filter: TrackFilter
    compute: Compute

    @cached_property
    def logic(self) -> TrackLogic:
        """The rule by which tracks are confirmed and deleted."""
        return track_logic(self.associate)

    def empty_table(self) -> TrackTable:
        """No tracks."""
        return empty(self.filter.filter, self.logic.size)

    def judged(self, before: TrackTable, result: Association, at: AssociationInput) -> tuple[TrackTable, Mask]:
        """The tracks after the scan, and which of them end."""
        hit, confirmed, scan = result.detection != NONE, before.id != NONE, at.detections.scan
        values = {
            "evidence": before.evidence,
            "hit": hit,
            "detection probability": at.detection_probability,
            "log ratio": result.log_ratio,
            "existence": result.existence,
            "confirmed": confirmed,
            "seen": before.seen,
            "time": scan.time,
        }
        silent = self.associate.delete_after_s - SAME_TIME
        after = self.compute(judgement(self.logic, silent, result.existence is not None), values)
        # Of none, which is -1, the last.
        used = np.concatenate([at.detections.column, [NONE]]).take(result.detection)
        ends = np.asarray(after["ends"], dtype=bool)
        table = before._replace(belief=result.belief, evidence=after["evidence"], used=used, seen=after["seen"])
        return table, ends

    def begun(self, at: AssociationInput, unclaimed: Array, origin: Indices | None) -> TrackTable | None:
        """A track for each detection that probably stems from none; None without any."""
        config, scan = self.associate, at.detections.scan
        existence: Array | None = None
        if config.method in COUNTING:
            which = unclaimed > CLAIMED
        else:
            new = at.intensity.new_objects
            existence = unclaimed * new / (at.intensity.false_alarms + new)
            which = existence >= config.delete_existence
        if origin is not None:
            which &= origin[0] >= 0
        own = indices(which)
        if not len(own):
            return None
        none = np.full(len(own), NONE)
        belief = self.filter.begin(selected_detections(scan, own))
        return TrackTable(
            at.detections.run[own],
            none,
            belief,
            np.full(len(own), scan.time),
            self.logic.begun(len(own), None if existence is None else existence[own]),
            at.detections.column[own],
            none if origin is None else origin[0, own],
        )
