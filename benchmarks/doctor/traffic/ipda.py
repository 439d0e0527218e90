"""Probabilistic data association with a probability of existence for each track, several objects; plain NumPy.

Linear multi-target integrated probabilistic data association: for each track, detections that others probably caused
count as more clutter (Musicki and La Scala 2008, "Multi-target tracking in clutter without measurement assignment").
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from ..plain_ekf import PlainEkf


@dataclass(frozen=True)
class Hypothesis:
    x: np.ndarray
    P: np.ndarray
    r: float
    begun: float
    seen: float
    id: int = -1


class Ipda:
    def __init__(
        self, gate=0.9995, born=0.05, confirm=0.97, delete=1e-3, lifetime=20.0, patience=1.0, acceleration=3.0
    ):
        self.filter = PlainEkf(velocity_sigma=12.0, acceleration_sigma=acceleration)
        self.gate, self.born, self.confirm, self.delete = gate, born, confirm, delete
        self.lifetime, self.patience = lifetime, patience

    def step(self, state, scan):
        time, issued, tracks = state or (scan.time, 0, [])
        tracks = [self.ahead(track, scan.time - time) for track in tracks]
        likely = self.likelihoods(tracks, scan)
        share = self.shares(tracks, likely, scan)
        after = [self.after(track, own, part, scan) for track, own, part in zip(tracks, likely, share, strict=True)]
        free = 1 - share.max(axis=0, initial=0.0)
        after = self.distinct([track for track in after if self.lasts(track, scan)])
        for j in self.starting(free):
            one = scan._replace(measurement=scan.measurement[:, j])
            position, noise = self.filter.position(one)
            after.append(
                Hypothesis(*self.filter.one_measurement(position, noise, one), self.born, scan.time, scan.time)
            )
        for number, track in enumerate(after):
            if track.id < 0 and track.r >= self.confirm:
                after[number] = replace(track, id=self.named(issued, after))
                issued += 1
        return (scan.time, issued, after), self.output(after)

    def ahead(self, track, dt):
        x, P = self.filter.predict(track.x, track.P, dt)
        return replace(track, x=x, P=P, r=track.r * np.exp(-dt / self.lifetime))

    def likelihoods(self, tracks, scan):
        """``(K, D)`` of each detection for each track, 0 outside its gate."""
        found = np.zeros((len(tracks), scan.measurement.shape[1]))
        for k, track in enumerate(tracks):
            for j, y, S in self.innovations(track, scan):
                d2 = y @ np.linalg.solve(S, y)
                if self.inside(d2, len(y)):
                    found[k, j] = np.exp(-d2 / 2) / np.sqrt(np.linalg.det(2 * np.pi * S))
        return found

    def innovations(self, track, scan):
        H, expected = self.filter.sensor_jacobian(track.x, scan), self.filter.predicted_measurement(track.x, scan)
        S = H @ track.P @ H.T + scan.noise_covariance
        for j in range(scan.measurement.shape[1]):
            yield j, self.filter.residual(scan.kind, scan.measurement[:, j].copy(), expected), S

    def inside(self, d2, size):
        return d2 < chi2.ppf(self.gate, size)

    def detects(self, scan):
        return scan.detection_probability

    def clutter(self, scan):
        return scan.clutter_density

    def shares(self, tracks, likely, scan):
        """``(K, D)`` probability that each detection stems from each track, with existence."""
        chance = self.detects(scan)
        r = np.array([track.r for track in tracks])[:, None]
        prior = chance * r * likely / self.clutter(scan)
        others = prior.sum(axis=0) - prior
        weight = prior / (1 + others)
        return weight / (1 - chance * self.gate * r + weight.sum(axis=1, keepdims=True))

    def after(self, track, likely, share, scan):
        hit = share.sum()
        miss = 1 - self.detects(scan) * self.gate
        missed = (1 - hit) * track.r * miss / (1 - track.r + track.r * miss)
        r = hit + missed
        if not r > 0:
            return replace(track, r=0.0)
        x, P = missed / r * track.x, missed / r * (track.P + np.outer(track.x, track.x))
        for j in np.flatnonzero(share):
            one = scan._replace(measurement=scan.measurement[:, j])
            xj, Pj = self.filter.update(track.x, track.P, one)
            x, P = x + share[j] / r * xj, P + share[j] / r * (Pj + np.outer(xj, xj))
        P = P - np.outer(x, x)
        return replace(track, x=x, P=(P + P.T) / 2, r=min(r, 1.0), seen=scan.time if hit > 0.5 else track.seen)

    def lasts(self, track, scan):
        return track.r > self.delete and scan.time - track.seen < self.patience

    def distinct(self, tracks):
        """Without those that are where an older one is."""
        kept: list[Hypothesis] = []
        for track in sorted(tracks, key=lambda track: (track.id < 0, track.begun, -track.r)):
            apart = [np.subtract(track.x, one.x) for one in kept]
            if all(d @ np.linalg.solve(track.P + one.P, d) > 1 for d, one in zip(apart, kept, strict=True)):
                kept.append(track)
        return kept

    def starting(self, free):
        return np.flatnonzero(free > 0.5)

    def named(self, issued, tracks):
        return issued

    def shown(self, tracks):
        return [track for track in tracks if track.id >= 0]

    def output(self, tracks):
        shown = self.shown(tracks)
        if not shown:
            return None
        return (
            np.array([track.id for track in shown]),
            np.array([track.x for track in shown]).T,
            np.moveaxis(np.array([track.P for track in shown]), 0, -1),
            np.array([track.r for track in shown]),
            None,
        )
