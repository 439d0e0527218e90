"""A global nearest neighbour with M-of-N logic, plain NumPy: nothing of trackbench in it.

Each piece that somebody could get wrong is a method of its own, so that a fault is one method replaced.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

from ..plain_ekf import PlainEkf

FAR = 1e6


@dataclass
class Track:
    x: np.ndarray
    P: np.ndarray
    hits: int = 1
    scans: int = 1
    missed: int = 0
    id: int = -1
    used: int = -1


class NearestGlobal:
    def __init__(
        self, filter=PlainEkf, gate=0.999, confirm=(2, 3), misses=10, used=True, velocity_sigma=15.0, acceleration=3.0
    ):
        self.filter = filter(velocity_sigma=velocity_sigma, acceleration_sigma=acceleration)
        self.gate, self.confirm, self.misses, self.gives_used = gate, confirm, misses, used
        self.tracks: list[Track] = []
        self.time = None
        self.count = 0

    def step(self, state, scan):
        self.predict(scan)
        z = scan.measurement
        column = self.associated(self.distances(scan), scan)
        for k, track in enumerate(self.tracks):
            j = column.get(k, -1)
            track.used = j
            track.scans += 1
            if j >= 0:
                track.x, track.P = self.filter.update(track.x, track.P, scan._replace(measurement=z[:, j]))
                track.hits += 1
                track.missed = 0
            else:
                self.miss(track, scan)
        begun = self.begun(scan, set(column.values()))
        self.tracks = [track for track in self.tracks if not self.ended(track)] + begun
        for track in self.tracks:
            if track.id < 0 and self.confirmed(track):
                track.id = self.next_id()
        return None, self.report(scan)

    def predict(self, scan):
        if self.time is not None:
            for track in self.tracks:
                track.x, track.P = self.filter.predict(track.x, track.P, scan.time - self.time)
        self.time = scan.time

    def distances(self, scan):
        """``(tracks, detections)`` squared Mahalanobis distance, and the logarithm of the determinant of S."""
        found = np.zeros((2, len(self.tracks), scan.measurement.shape[1]))
        for k, track in enumerate(self.tracks):
            S, innovations = self.innovations(track, scan)
            found[0, k] = np.sum(innovations * np.linalg.solve(S, innovations), axis=0)
            found[1, k] = np.log(np.linalg.det(S))
        return found

    def innovations(self, track, scan):
        filter, z = self.filter, scan.measurement
        if hasattr(filter, "sensor_jacobian"):
            H = filter.sensor_jacobian(track.x, scan)
            expected = filter.predicted_measurement(track.x, scan)
            y = [filter.residual(scan.kind, z[:, j].copy(), expected) for j in range(z.shape[1])]
            return H @ track.P @ H.T + filter.noise(scan), np.array(y).reshape(-1, len(H)).T
        positions = [filter.position(scan._replace(measurement=z[:, j])) for j in range(z.shape[1])]
        R = positions[0][1] if positions else np.eye(2)
        return track.P[:2, :2] + R, np.array([p - track.x[:2] for p, _ in positions]).reshape(-1, 2).T

    def inside(self, d2, scan):
        size = len(scan.noise_covariance) if hasattr(self.filter, "sensor_jacobian") else 2
        return d2 < chi2.ppf(self.gate, size)

    def associated(self, distances, scan):
        """The column of each track that takes one."""
        d2, spread = distances
        cost = np.where(self.inside(d2, scan), d2 + spread, FAR)
        return {k: j for k, j in zip(*linear_sum_assignment(cost), strict=True) if cost[k, j] < FAR}

    def miss(self, track, scan):
        track.missed += 1

    def begun(self, scan, taken):
        free = [j for j in range(scan.measurement.shape[1]) if j not in taken]
        return [self.born(scan, j) for j in free]

    def born(self, scan, j):
        own = scan._replace(measurement=scan.measurement[:, j])
        position, noise = self.filter.first_position(own)
        return Track(*self.filter.one_measurement(position, noise, own), used=j)

    def confirmed(self, track):
        return track.hits >= self.confirm[0]

    def ended(self, track):
        if track.id >= 0:
            return track.missed >= self.misses
        needed, scans = self.confirm
        return track.scans - track.hits > scans - needed

    def next_id(self):
        self.count += 1
        return self.count - 1

    def reported(self):
        return [track for track in self.tracks if track.id >= 0]

    def report(self, scan) -> Any:
        shown = self.reported()
        if not shown:
            return None
        return (
            np.array([track.id for track in shown]),
            np.stack([track.x for track in shown], axis=-1),
            np.stack([track.P for track in shown], axis=-1),
            None,
            np.array([track.used for track in shown]) if self.gives_used else None,
        )
