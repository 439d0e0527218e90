"""Faults in the tracker by score: options, and methods that override its own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .greedy_score import GreedyScore
from .subject import TrafficSubject, looped


class AsListed(GreedyScore):
    """Each detection in the order of the list takes the nearest free track."""

    def pairs(self, state, points, spread):
        d2 = self.squared(state, points, spread)[0]
        found = []
        for j in range(d2.shape[1]):
            k = int(np.argmin(d2[:, j])) if len(d2) else -1
            if k >= 0 and d2[k, j] < self.gate**2:
                found.append((k, j))
                d2[k] = np.inf
        return found


class StartsFromAll(GreedyScore):
    """Detections that a track took start another, and tracks share detections."""

    def pairs(self, state, points, spread):
        d2 = self.squared(state, points, spread)[0]
        return [(k, int(row.argmin())) for k, row in enumerate(d2) if len(row) and row.min() < self.gate**2]

    def beginning(self, points, taken):
        return list(range(len(points)))


class MissesForgiven(GreedyScore):
    def lost(self, chance):
        return 0.0

    def lasting(self, state, scan):
        return state["score"] > self.delete


class StaysAtEmptyScan(GreedyScore):
    def ahead(self, state, scan):
        return state if not len(scan.valid) else super().ahead(state, scan)


class RowNumbers(GreedyScore):
    def output(self, state):
        state, (ids, mean, covariance) = super().output(state)
        return state, (np.arange(len(ids)), mean, covariance)


class NoLimit(GreedyScore):
    """The gate is 100 m."""

    def squared(self, state, points, spread):
        _, y, S = super().squared(state, points, spread)
        return np.hypot(y[..., 0], y[..., 1]) * self.gate / 100, y, S


def subjects() -> Iterator[TrafficSubject]:
    for fault, variant, options in (
        ("gate_too_small", "half a standard deviation", {"gate": 0.5}),
        ("gate_too_small", "1.2 standard deviations", {"gate": 1.2}),
        ("gate_too_large", "12 standard deviations", {"gate": 12.0}),
        ("confirms_too_late", "score of 400", {"confirm": 400.0, "best": 500.0}),
        ("confirms_too_soon", "score of 0", {"confirm": 0.0}),
        ("never_deletes", "five seconds", {"patience": 5.0, "delete": -1e9}),
    ):
        yield TrafficSubject(fault, "greedy score", variant, looped(GreedyScore, **options))
    for fault, kind in {
        "order_dependent": AsListed,
        "double_tracks": StartsFromAll,
        "never_deletes": MissesForgiven,
        "empty_scan_not_predicted": StaysAtEmptyScan,
        "ids_reused": RowNumbers,
        "gate_too_large": NoLimit,
    }.items():
        yield TrafficSubject(fault, "greedy score", kind.__name__, looped(kind))
