"""Rules for tracks to begin, to be confirmed and to be deleted."""

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


class ScanEvidence(NamedTuple):
    """Evidence of one scan on the existence of each track's object."""

    hit: Mask
    """Mask ``(L,)``, True for a track with a detection in the scan."""
    in_view: Mask
    """Mask ``(L,)``, True for a track whose object the scan could have detected."""
    log_ratio: Array
    """Log-likelihood ratio ``(L,)`` of the scan's detections with the track's object to false alarms alone."""
    existence: Array | None
    """Probabilities ``(2, L)`` of existence and, given existence, of being visible; None for a method without them."""


#: Score at which ``confirm: score`` confirms a track, and drop from its largest score that deletes it.
CONFIRMING_SCORE, SCORE_DROP = 12.0, 10.0
#: Mean time for which a hidden object stays hidden, s.
HIDDEN_S = 1.0
#: Rows of the evidence: probabilities that the object exists, and that an existing object is visible to the sensors;
#: numbers of detections and of scans in view; the score, 0 at the first detection, and its largest value.
EXISTS, VISIBLE, DETECTIONS, SCANS, SCORE, LARGEST_SCORE = range(6)


@dataclass(frozen=True)
class TrackLogic:
    """Rule that confirms and deletes tracks by their evidence ``(6, L)``, with rows ``EXISTS`` to ``LARGEST_SCORE``.

    M of N: M detections in the first N scans confirm; a tentative track that can no longer have them is deleted. Score:
    the log-likelihood ratio of object and false alarms confirms, and deletes when it falls; Blackman and Popoli (1999),
    "Design and Analysis of Modern Tracking Systems", section 6.2. Existence probability: Musicki, Evans and Stankovic
    (1994), "Integrated probabilistic data association", Markov chain two: an object may be hidden.
    """

    rule: tuple[int, int] | Literal["score", "existence"]
    has_existence: bool
    """Whether the association computes existence probabilities; then a small one deletes a track."""
    confirming: float
    """Existence probability from which a track is confirmed."""
    deleting: float
    """Existence probability below which a track is deleted."""
    lifetime_s: float
    """Mean time for which an object stays in the scene, s."""
    hides: float
    """Rate at which a visible object becomes hidden, 1/s."""

    @classmethod
    def of(cls, config: AssociateConfig) -> TrackLogic:
        """Return the rule that a tracker's options state."""
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

    def first_evidence(self, count: int, existence: Array | None) -> Array:
        """Return evidence ``(6, count)`` of tracks begun by a detection: rows ``EXISTS`` to ``LARGEST_SCORE``."""
        evidence = np.zeros((6, count))
        evidence[:SCORE] = 1.0
        if existence is not None:
            evidence[EXISTS] = existence
        return evidence

    def after_time(self, evidence: Array, elapsed: float) -> Array:
        """Return the evidence ``(6, L)`` on existence ``elapsed`` seconds later, before the next scan.

        Only a method with existence probabilities needs this.
        """
        rate, later = self.hides + 1.0 / HIDDEN_S, evidence.copy()
        limit = 1.0 / HIDDEN_S / rate
        later[EXISTS] = evidence[EXISTS] * np.exp(-elapsed / self.lifetime_s)
        later[VISIBLE] = limit + (evidence[VISIBLE] - limit) * np.exp(-rate * elapsed)
        return later

    def after_scan(self, evidence: Array, judged: ScanEvidence) -> Array:
        """Return the evidence ``(6, L)`` on the existence of each track's object, updated with that of a scan."""
        existence = evidence[:DETECTIONS] if judged.existence is None else judged.existence
        counts = evidence[DETECTIONS] + judged.hit, evidence[SCANS] + judged.in_view
        scores = evidence[SCORE], evidence[LARGEST_SCORE]
        if self.rule == "score":
            score = evidence[SCORE] + judged.log_ratio
            scores = score, np.maximum(score, evidence[LARGEST_SCORE])
        return linalg.vector([existence[EXISTS], existence[VISIBLE], *counts, *scores])

    def confirms(self, evidence: Array) -> Mask:
        """Return a mask ``(L,)`` of the tracks that are confirmed and get an id."""
        if self.rule == "score":
            return np.asarray(evidence[SCORE] >= CONFIRMING_SCORE)
        if self.rule == "existence":
            return np.asarray(evidence[EXISTS] >= self.confirming)
        return np.asarray(evidence[DETECTIONS] >= self.rule[0])

    def deletes(self, evidence: Array, confirmed: Mask) -> Mask:
        """Return a mask ``(L,)`` of the tracks that the rule deletes for want of evidence."""
        is_ending: Mask = evidence[EXISTS] < (self.deleting if self.has_existence else 0.0)
        if self.rule == "score":
            is_ending = is_ending | (evidence[SCORE] <= evidence[LARGEST_SCORE] - SCORE_DROP)
        elif not isinstance(self.rule, str):
            needed, scans = self.rule
            is_ending = is_ending | (~confirmed & (evidence[SCANS] - evidence[DETECTIONS] > scans - needed))
        return is_ending


def judgement(logic: TrackLogic, silent_s: float, existence: bool) -> Equations:
    """Return equations that update evidence and time of latest detection with a scan, and say which tracks end.

    A track also ends ``silent_s`` after its latest detection. ``existence``: whether tracks have such a probability.
    """

    def function(values: Values) -> Values:
        hit = values["hit"]
        in_view = hit | (values["detection probability"] > 0.0)
        judged = ScanEvidence(hit, in_view, values["log ratio"], values["existence"] if existence else None)
        evidence = logic.after_scan(values["evidence"], judged)
        seen = np.where(hit, values["time"], values["seen"])
        ends = logic.deletes(evidence, values["confirmed"]) | (values["time"] - seen > silent_s)
        return {"evidence": evidence, "seen": seen, "ends": ends}

    ranks = dict.fromkeys(("hit", "detection probability", "log ratio", "seen", "confirmed", "time"), 0)
    ranks |= {"evidence": 1} | ({"existence": 1} if existence else {})
    return Equations("evidence of tracks", function, ranks, key=(*vars(logic).values(), silent_s))


@dataclass(frozen=True)
class TrackManager:
    """Rule that begins and ends tracks after the detections of a scan have been associated."""

    associate: AssociateConfig
    filter: TrackFilter
    compute: Compute

    @cached_property
    def logic(self) -> TrackLogic:
        """Rule that confirms and deletes tracks, as the tracker's options state it."""
        return TrackLogic.of(self.associate)

    @cached_property
    def _judgement(self) -> Equations:
        associate = self.associate
        return judgement(self.logic, associate.delete_after_s - SAME_TIME, associate.method in EXISTENCE)

    def empty_table(self) -> TrackTable:
        return empty(self.filter.filter, len(self.logic.first_evidence(0, None)))

    def after_scan(self, before: TrackTable, result: Association, inputs: AssociationInput) -> tuple[TrackTable, Mask]:
        """Return the tracks after the association of a scan, and a mask ``(L,)`` of those that end at this scan."""
        hit, confirmed, scan = result.detection != NONE, before.id != NONE, inputs.detections.scan
        values = {
            "evidence": before.evidence,
            "hit": hit,
            "detection probability": inputs.detection_probability,
            "log ratio": result.log_ratio,
            "existence": result.existence,
            "confirmed": confirmed,
            "seen": before.seen,
            "time": scan.time,
        }
        after = self.compute(self._judgement, values)
        used = result.detection.copy()
        used[hit] = inputs.detections.column.take(result.detection[hit])
        ends = np.asarray(after["ends"], dtype=bool)
        seen, evidence = after["seen"], after["evidence"]
        return TrackTable(before.run, before.id, result.belief, seen, evidence, used, before.origin), ends

    def new_tracks(self, inputs: AssociationInput, unclaimed: Array, origin: Indices | None) -> TrackTable | None:
        """Return a track for each detection that probably stems from no existing track; None if there is none."""
        config, scan = self.associate, inputs.detections.scan
        existence: Array | None = None
        if config.method in COUNTING:
            is_starting = unclaimed > CLAIMED
        else:
            new = inputs.intensity.new_objects
            existence = unclaimed * new / (inputs.intensity.false_alarms + new)
            is_starting = existence >= config.delete_existence
        if origin is not None:
            is_starting &= origin[0] >= 0
        starting = is_starting.nonzero()[0]
        if not len(starting):
            return None
        no_index, seen = np.empty(len(starting), dtype=np.intp), np.empty(len(starting))
        no_index.fill(NONE)
        seen.fill(scan.time)
        belief = self.filter.begin(selected_detections(scan, starting))
        return TrackTable(
            inputs.detections.run[starting],
            no_index,
            belief,
            seen,
            self.logic.first_evidence(len(starting), None if existence is None else existence[starting]),
            inputs.detections.column[starting],
            no_index if origin is None else origin[0, starting],
        )
