"""Faults in the global nearest neighbour: options, and methods that override its own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import linear_sum_assignment

from .nearest_global import FAR, NearestGlobal
from .subject import TrafficSubject, looped


class ThresholdOfOne(NearestGlobal):
    def inside(self, d2, scan):
        return d2 < 1.0


class ThresholdOfOneComponent(NearestGlobal):
    """chi2 of one degree of freedom at 0.7: a quantile of the wrong table."""

    def inside(self, d2, scan):
        return d2 < 1.07


class SquareForgotten(NearestGlobal):
    """The distance, not its square, is held against chi-square."""

    def inside(self, d2, scan):
        return super().inside(np.sqrt(d2), scan)


class NoGate(NearestGlobal):
    def inside(self, d2, scan):
        return d2 < FAR / 2


class GateInMetres(NearestGlobal):
    """30 m around the predicted position."""

    def associated(self, distances, scan):
        z = scan.measurement
        x, y = (z[0] * np.cos(z[1]), z[0] * np.sin(z[1])) if scan.kind == "radar" else z
        self.near = np.array([np.hypot(x - track.x[0], y - track.x[1]) < 30 for track in self.tracks])
        return super().associated(distances, scan)

    def inside(self, d2, scan):
        return self.near.reshape(d2.shape)


class ReportsAll(NearestGlobal):
    def confirmed(self, track):
        return True


class MissesNotCounted(NearestGlobal):
    def miss(self, track, scan):
        pass


class MissesOfFullScansOnly(NearestGlobal):
    def miss(self, track, scan):
        if scan.measurement.shape[1]:
            super().miss(track, scan)


class TentativeAgain(NearestGlobal):
    """Tracks that take a detection start another one as long as they are tentative, and share detections."""

    def associated(self, distances, scan):
        d2, spread = distances
        cost = np.where(self.inside(d2, scan), d2 + spread, FAR)
        return {k: int(row.argmin()) for k, row in enumerate(cost) if len(row) and row.min() < FAR}

    def begun(self, scan, taken):
        sure = {track.used for track in self.tracks if track.id >= 0}
        return [self.born(scan, j) for j in range(scan.measurement.shape[1]) if j not in sure]


class EachTwice(NearestGlobal):
    """Two tracks start from each detection, and take the same ones."""

    def associated(self, distances, scan):
        return TentativeAgain.associated(self, distances, scan)

    def begun(self, scan, taken):
        return [*super().begun(scan, taken), *super().begun(scan, taken)]


class SmallestFree(NearestGlobal):
    def next_id(self):
        used = {track.id for track in self.tracks}
        return next(number for number in range(len(used) + 1) if number not in used)


class PlaceInList(NearestGlobal):
    def report(self, scan):
        for number, track in enumerate(self.reported()):
            track.id = number
        return super().report(scan)


class CountsModulo(NearestGlobal):
    """A counter of three bits."""

    def next_id(self):
        return super().next_id() % 8


class CounterReset(NearestGlobal):
    def report(self, scan):
        if not self.tracks:
            self.count = 0
        return super().report(scan)


class DetectionsInOrder(NearestGlobal):
    """Each detection takes the nearest track that is free."""

    def associated(self, distances, scan):
        d2 = np.where(self.inside(distances[0], scan), distances[0], FAR)
        taken = {}
        for j in range(d2.shape[1]):
            if len(d2) and d2[:, j].min() < FAR:
                k = int(d2[:, j].argmin())
                taken[k] = j
                d2[k] = FAR
        return taken


class TracksInOrder(NearestGlobal):
    """Each track, in the order of their first detections, takes the nearest detection that is free."""

    def associated(self, distances, scan):
        d2 = np.where(self.inside(distances[0], scan), distances[0], FAR)
        taken = {}
        for k, row in enumerate(d2):
            if len(row) and row.min() < FAR:
                taken[k] = int(row.argmin())
                d2[:, taken[k]] = FAR
        return taken


class LastAnswer(NearestGlobal):
    """Nothing is done at an empty scan."""

    def step(self, state, scan):
        if not scan.measurement.shape[1] and self.time is not None:
            for track in self.tracks:
                track.used = -1
            return None, self.report(scan)
        return super().step(state, scan)


class TimeAlone(NearestGlobal):
    """Misses are counted at an empty scan, and the tracks stay where they are."""

    def predict(self, scan):
        if scan.measurement.shape[1]:
            super().predict(scan)


class NothingToSay(NearestGlobal):
    def step(self, state, scan):
        if not scan.measurement.shape[1]:
            return None, None
        return super().step(state, scan)


class MatchedFirst(NearestGlobal):
    """Predicts between the association and the update."""

    def predict(self, scan):
        pass

    def associated(self, distances, scan):
        column = super().associated(distances, scan)
        super().predict(scan)
        return column


class NewOnesWait(NearestGlobal):
    """Tracks are predicted once they are confirmed."""

    def __init__(self, confirm=(3, 4), **options):
        super().__init__(confirm=confirm, **options)

    def predict(self, scan):
        waiting = [(track, track.x, track.P) for track in self.tracks if track.id < 0]
        super().predict(scan)
        for track, x, P in waiting:
            track.x, track.P = x, P


class GatedLast(NearestGlobal):
    """Drops pairs beyond the gate from an assignment of all."""

    def associated(self, distances, scan):
        inside = self.inside(distances[0], scan)
        return {k: j for k, j in zip(*linear_sum_assignment(distances.sum(axis=0)), strict=True) if inside[k, j]}


class LargestSum(NearestGlobal):
    """The assignment has the largest sum of distances."""

    def associated(self, distances, scan):
        score = np.where(self.inside(distances[0], scan), distances.sum(axis=0), -FAR)
        pairs = zip(*linear_sum_assignment(score, maximize=True), strict=True)
        return {k: j for k, j in pairs if score[k, j] > -FAR}


class Farthest(NearestGlobal):
    """Each track in turn takes the farthest detection in its gate that is free."""

    def associated(self, distances, scan):
        d2 = np.where(self.inside(distances[0], scan), distances[0], -1.0)
        taken = {}
        for k, row in enumerate(d2):
            if len(row) and row.max() >= 0:
                taken[k] = int(row.argmax())
                d2[:, taken[k]] = -1.0
        return taken


class AssignedIsSeen(NearestGlobal):
    """A pair beyond the gate is dropped after its track was counted as seen."""

    def associated(self, distances, scan):
        self.paired = set(linear_sum_assignment(distances[0])[0].tolist())
        return super().associated(distances, scan)

    def miss(self, track, scan):
        k = next(k for k, one in enumerate(self.tracks) if one is track)
        track.missed = 0 if k in self.paired else track.missed + 1


class PoppedInOrder(NearestGlobal):
    """Removes tracks by their first places in the list, which are others' once one is removed."""

    def ended(self, track):
        if track is self.tracks[0]:
            self.left = list(self.tracks)
            for k in [k for k, one in enumerate(self.tracks) if super(PoppedInOrder, self).ended(one)]:
                self.removed(k)
        return not any(track is one for one in self.left)

    def removed(self, k):
        del self.left[min(k, len(self.left) - 1)]


class LastRemoved(PoppedInOrder):
    def removed(self, k):
        self.left.pop()


def subjects() -> Iterator[TrafficSubject]:
    for gate in (0.2, 0.5, 0.8):
        yield _of("gate_too_small", f"{gate}", gate=gate)
    for confirm in ((25, 30), (40, 60)):
        yield _of("confirms_too_late", f"{confirm[0]} of {confirm[1]}", confirm=confirm)
    for confirm in ((1, 1), (1, 5)):
        yield _of("confirms_too_soon", f"1 of {confirm[1]}", confirm=confirm)
    for misses in (80, 10**6):
        yield _of("never_deletes", f"{misses} misses", misses=misses)
    for fault, kinds in {
        "gate_too_small": (ThresholdOfOne, ThresholdOfOneComponent),
        "gate_too_large": (SquareForgotten, NoGate, GateInMetres),
        "confirms_too_soon": (ReportsAll,),
        "never_deletes": (MissesNotCounted, MissesOfFullScansOnly, AssignedIsSeen),
        "double_tracks": (TentativeAgain, EachTwice),
        "ids_reused": (SmallestFree, PlaceInList, CountsModulo, CounterReset),
        "order_dependent": (DetectionsInOrder, TracksInOrder),
        "empty_scan_not_predicted": (LastAnswer, TimeAlone, NothingToSay),
        "associated_unpredicted": (MatchedFirst, NewOnesWait),
        "gated_after_assignment": (GatedLast,),
        "assignment_inverted": (LargestSum, Farthest),
        "wrong_track_deleted": (PoppedInOrder, LastRemoved),
    }.items():
        for kind in kinds:
            yield TrafficSubject(fault, "nearest global", kind.__name__, looped(kind))


def _of(fault: str, variant: str, **options) -> TrafficSubject:
    return TrafficSubject(fault, "nearest global", variant, looped(NearestGlobal, **options))
