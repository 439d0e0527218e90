"""Probabilistic data association, each track for itself; a track is confirmed by four hits among six looks.

Before that it takes the nearest detection, since its gate is still wide enough for those of its neighbours.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from benchmarks.faults import parts

INSIDE = 0.9997  # of an object's detections
GATES = {2: 16.22, 3: 18.80}


@dataclass(frozen=True)
class Track:
    x: np.ndarray
    P: np.ndarray
    seen: float
    looks: tuple = field(default=(True,))
    name: int | None = None


def begin(detection, time):
    z, H, R = detection
    x, P = np.array([*z[:2], 0.0, 0.0]), np.diag([1e4, 1e4, 600.0, 600.0])
    return Track(*parts.updated(x, P, z, H, R), time)


def squared(d, P):
    return d @ np.linalg.solve(P, d)


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        time, names, tracks = state or (scan.time, 0, ())
        detections = [parts.linear(scan, d) for d in scan.measurement.T]
        claimed, kept = np.zeros(len(detections)), []
        for track in sorted(tracks, key=lambda t: (t.name is None, t.name or 0)):  # confirmed ones first
            x, P = parts.moved(track.x, track.P, scan.time - time)
            track, share = self.associated(replace(track, x=x, P=P), detections, scan, claimed)
            claimed += share
            if track.name is None and sum(track.looks) >= 4:
                track, names = replace(track, name=names), names + 1
            if self.worthwhile(track, scan.time):
                kept.append(track)
        kept = self.apart(kept)
        kept += [begin(d, scan.time) for d, c in zip(detections, claimed, strict=True) if c < 0.1]
        return (scan.time, names, tuple(kept)), self.shown(kept)

    def associated(self, track, detections, scan, claimed):
        """The track after the scan, and the probability of each detection to be its own."""
        visible = parts.in_view(track.x, scan)
        detected = scan.detection_probability if visible else 0.02
        weights, terms = [1 - detected * INSIDE], [(track.x, track.P)]
        share = np.zeros(len(detections))
        for j, (z, H, R) in enumerate(detections):
            if track.name is None and claimed[j] > 0.1:
                continue
            y, S = z - H @ track.x, H @ track.P @ H.T + R
            d2 = y @ np.linalg.solve(S, y)
            if d2 > GATES[len(z)]:
                continue
            r = scan.measurement[0, j] if scan.kind == "radar" else 1.0  # area of a radian and a metre
            density = scan.clutter_density / r + 1e-9
            share[j] = detected * np.exp(-d2 / 2) / np.sqrt(np.linalg.det(2 * np.pi * S)) / density
            weights.append(share[j])
            terms.append(parts.updated(track.x, track.P, z, H, R))
        if track.name is None and len(terms) > 1:
            best = int(np.argmax(weights[1:])) + 1
            weights, terms = [weights[0], weights[best]], [terms[0], terms[best]]
            share[share < share.max()] = 0.0
        total = sum(weights)
        weights = np.array(weights) / total
        x = sum(w * m for w, (m, _) in zip(weights, terms, strict=True))
        P = sum(w * (C + np.outer(m - x, m - x)) for w, (m, C) in zip(weights, terms, strict=True))
        hit = bool(weights[0] < 0.5)
        looks = (*track.looks, hit)[-6:] if visible or hit else track.looks
        seen = scan.time if hit else track.seen
        return replace(track, x=x, P=(P + P.T) / 2, seen=seen, looks=looks), share / total

    def apart(self, tracks):
        """Without the younger of two confirmed tracks that follow the same object."""
        result = []
        for track in tracks:
            twins = (t for t in result if t.name is not None and np.hypot(*(t.x - track.x)[:2]) < 1.0)
            if track.name is None or not any(squared(t.x - track.x, t.P + track.P) < 9.0 for t in twins):
                result.append(track)
        return result

    def worthwhile(self, track, time):
        if track.name is None and track.looks.count(False) > 2:
            return False
        return time - track.seen < 1.0

    def shown(self, tracks):
        tracks = [t for t in tracks if t.name is not None]
        if not tracks:
            return None
        return (
            np.array([t.name for t in tracks]),
            np.array([t.x for t in tracks]).T,
            np.stack([t.P for t in tracks], -1),
        )
