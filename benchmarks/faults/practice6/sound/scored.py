"""Tracks live by a score, the logarithm of the odds that there is an object, as in the sequential ratio test.

Detections are assigned by what they add to the scores.
"""

import numpy as np
from benchmarks.faults import parts
from scipy.optimize import linear_sum_assignment

GATES = {2: 18.0, 3: 20.6}
CONFIRM, END, MOST = 6.0, -3.0, 12.0
FALL = 3.0  # from the highest score to the end of a track
FADE = 2.0  # 1/s, where no sensor looks


class Track:
    def __init__(self, x, P):
        self.x, self.P, self.score, self.top, self.number, self.hits = x, P, 0.0, 0.0, None, 1


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.tracks, self.time, self.count = [], None, 0

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        for track in self.tracks:
            track.x, track.P = parts.moved(track.x, track.P, dt, 2.5)
            track.score -= FADE * dt
        detections = [parts.linear(scan, d) for d in scan.measurement.T]
        gain = self.gains(detections, scan)
        rest = self.assigned(gain, detections, scan)
        for track in self.tracks:
            track.score = min(track.score, MOST)
            track.top = max(track.top, track.score)
            if track.number is None and track.score > CONFIRM and track.hits >= 3:
                track.number, self.count = self.count, self.count + 1
        self.tracks = [
            t for t in self.tracks if t.score > END and t.score > t.top - (FALL if t.number is None else 6.0)
        ]
        self.tracks += [self.begun(detections[j]) for j in rest]
        return None, self.shown()

    def gains(self, detections, scan):
        """What a detection adds to a track's score, zero beyond the gate."""
        gain = np.zeros((len(self.tracks), len(detections)))
        for i, t in enumerate(self.tracks):
            for j, (z, H, R) in enumerate(detections):
                y, S = z - H @ t.x, H @ t.P @ H.T + R
                d2 = y @ np.linalg.solve(S, y)
                if d2 < GATES[len(z)]:
                    r = max(scan.measurement[0, j], 1.0) if scan.kind == "radar" else 1.0
                    false = scan.clutter_density / r + 1e-7
                    gain[i, j] = np.log(scan.detection_probability / false)
                    gain[i, j] -= (d2 + np.linalg.slogdet(2 * np.pi * S)[1]) / 2
                    gain[i, j] = max(gain[i, j], -2.0) + 30.0  # any detection in the gate is better than none
        return gain

    def assigned(self, gain, detections, scan):
        """The detections that are left."""
        rest, hit = set(range(len(detections))), set()
        for i, j in zip(*linear_sum_assignment(-gain), strict=True) if gain.size else ():
            if gain[i, j] > 0:
                t = self.tracks[i]
                t.x, t.P = parts.updated(t.x, t.P, *detections[j])
                t.score, t.hits = t.score + gain[i, j] - 30.0, t.hits + 1
                rest.discard(int(j))
                hit.add(int(i))
        for i, t in enumerate(self.tracks):
            if i not in hit and parts.in_view(t.x, scan):
                t.score += np.log(1 - scan.detection_probability + 1e-3)
        return sorted(rest)

    def begun(self, detection):
        z, _, R = detection
        P = np.diag([0.0, 0.0, 400.0, 400.0])
        P[:2, :2] = R[:2, :2]
        return Track(np.array([*z[:2], 0.0, 0.0]), P)

    def shown(self):
        shown = [t for t in self.tracks if t.number is not None]
        if not shown:
            return None
        return (
            np.array([t.number for t in shown]),
            np.column_stack([t.x for t in shown]),
            np.dstack([t.P for t in shown]),
        )
