"""When a track begins, when it is confirmed, and when it is deleted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices, Mask
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


#: Score at which ``confirm: score`` confirms a track, and how far below its largest it deletes it.
CONFIRMING_SCORE, SCORE_DROP = 12.0, 10.0
#: Mean time for which a hidden object stays so, s.
HIDDEN_S = 1.0
#: Rows of the evidence: probabilities that the object exists, and that it is not hidden from the sensors if so; numbers
#: of detections and of scans in view; the score, 0 at the first detection, and its largest value.
EXISTS, VISIBLE, DETECTIONS, SCANS, SCORE, LARGEST_SCORE = range(6)


@dataclass(frozen=True)
class TrackLogic:
    """When tracks are confirmed and when they end, by their evidence ``(6, L)``.

    M detections in the first N scans confirm; a tentative track that can no longer have them is deleted. Or the score
    does, the log-likelihood ratio of object and false alarms, and deletes a track when it falls: Blackman and Popoli
    (1999), "Design and Analysis of Modern Tracking Systems", section 6.2. Or the existence probability does: Musicki,
    Evans and Stankovic (1994), "Integrated probabilistic data association", Markov chain two.
    """

    rule: tuple[int, int] | Literal["score", "existence"]
    has_existence: bool
    """Whether the method has existence probabilities, of which a small one deletes a track."""
    confirming: float
    """Existence probability that confirms."""
    deleting: float
    """Existence probability below which a track is deleted."""
    lifetime_s: float
    """Mean, s."""
    hides: float
    """Rate at which visible objects hide, 1/s."""

    @classmethod
    def of(cls, config: AssociateConfig) -> TrackLogic:
        """Return the rule that the options describe."""
        rule = config.confirms_by
        hides = 0.0 if config.visible_s is None else 1.0 / config.visible_s
        return cls(
            rule if isinstance(rule, str) else (rule[0], rule[1]),
            config.method in EXISTENCE,
            config.report_limits[0],
            config.delete_existence,
            config.lifetime_s,
            hides,
        )

    def begun(self, count: int, existence: Array | None) -> Array:
        """Return the evidence of tracks that begin with a detection."""
        evidence = np.zeros((6, count))
        evidence[:SCORE] = 1.0
        if existence is not None:
            evidence[EXISTS] = existence
        return evidence

    def after_time(self, evidence: Array, elapsed: float) -> Array:
        """Return the evidence some seconds later, of a method that has existence probabilities."""
        rate, later = self.hides + 1.0 / HIDDEN_S, evidence.copy()
        at_last = 1.0 / HIDDEN_S / rate
        later[EXISTS] = evidence[EXISTS] * np.exp(-elapsed / self.lifetime_s)
        later[VISIBLE] = at_last + (evidence[VISIBLE] - at_last) * np.exp(-rate * elapsed)
        return later

    def after_scan(self, evidence: Array, judged: Judged) -> Array:
        """Return the evidence after a scan."""
        existence = evidence[:DETECTIONS] if judged.existence is None else judged.existence
        counts = evidence[DETECTIONS] + judged.hit, evidence[SCANS] + judged.in_view
        scores = evidence[SCORE], evidence[LARGEST_SCORE]
        if self.rule == "score":
            score = evidence[SCORE] + judged.log_ratio
            scores = score, np.maximum(score, evidence[LARGEST_SCORE])
        return linalg.vector([existence[EXISTS], existence[VISIBLE], *counts, *scores])

    def confirms(self, evidence: Array) -> Mask:
        """``(L,)`` tracks that get an id."""
        if self.rule == "score":
            return np.asarray(evidence[SCORE] >= CONFIRMING_SCORE)
        if self.rule == "existence":
            return np.asarray(evidence[EXISTS] >= self.confirming)
        return np.asarray(evidence[DETECTIONS] >= self.rule[0])

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        """``(L,)`` tracks that end."""
        ends: Mask = evidence[EXISTS] < (self.deleting if self.has_existence else 0.0)
        if self.rule == "score":
            ends = ends | (evidence[SCORE] <= evidence[LARGEST_SCORE] - SCORE_DROP)
        elif not isinstance(self.rule, str):
            needed, scans = self.rule
            ends = ends | (~confirmed & (evidence[SCANS] - evidence[DETECTIONS] > scans - needed))
        return ends


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
    return Equations("evidence of tracks", function, ranks, key=(*vars(logic).values(), silent_s))


@dataclass(frozen=True)
class TrackManager:
    """Tells which tracks end and which begin after the detections of a scan are associated."""

    associate: AssociateConfig
    filter: TrackFilter
    compute: Compute

    @cached_property
    def logic(self) -> TrackLogic:
        """The rule by which tracks are confirmed and deleted."""
        return TrackLogic.of(self.associate)

    @cached_property
    def _judgement(self) -> Equations:
        associate = self.associate
        return judgement(self.logic, associate.delete_after_s - SAME_TIME, associate.method in EXISTENCE)

    def empty_table(self) -> TrackTable:
        """No tracks."""
        return empty(self.filter.filter, len(self.logic.begun(0, None)))

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
        after = self.compute(self._judgement, values)
        used = result.detection.copy()
        used[hit] = at.detections.column.take(result.detection[hit])
        ends = np.asarray(after["ends"], dtype=bool)
        seen, evidence = after["seen"], after["evidence"]
        return TrackTable(before.run, before.id, result.belief, seen, evidence, used, before.origin), ends

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
        own = which.nonzero()[0]
        if not len(own):
            return None
        none, seen = np.empty(len(own), dtype=np.intp), np.empty(len(own))
        none.fill(NONE)
        seen.fill(scan.time)
        belief = self.filter.begin(selected_detections(scan, own))
        return TrackTable(
            at.detections.run[own],
            none,
            belief,
            seen,
            self.logic.begun(len(own), None if existence is None else existence[own]),
            at.detections.column[own],
            none if origin is None else origin[0, own],
        )
