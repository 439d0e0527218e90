"""The nearest pair first, and tracks by their score (sequential probability ratio test), on arrays; plain NumPy.

Positions only, with the range rate for the first velocity. Time, not scans, ends a track.
"""

from __future__ import annotations

import numpy as np

NOTHING = {"x": np.zeros((0, 4)), "P": np.zeros((0, 4, 4)), "score": np.zeros(0), "seen": np.zeros(0)}


class GreedyScore:
    def __init__(self, gate=4.5, confirm=8.0, delete=-3.0, patience=0.7, drive=3.0, speed=15.0, best=25.0):
        """``gate`` in standard deviations; ``confirm`` and ``delete`` scores; ``patience`` s; ``best`` score kept."""
        self.gate, self.confirm, self.delete, self.patience = gate, confirm, delete, patience
        self.drive, self.speed, self.best = drive, speed, best
        self.issued = 0

    def step(self, state, scan):
        if state is None:
            state = {"time": scan.time, "id": np.zeros(0, dtype=int), **NOTHING}
        state = self.ahead(state, scan)
        points, spread = self.points(scan)
        pairs = self.pairs(state, points, spread)
        return self.output(self.managed(self.updated(state, points, spread, pairs, scan), points, spread, pairs, scan))

    def ahead(self, state, scan):
        dt = scan.time - state["time"]
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        G = np.array([[dt * dt / 2, 0], [0, dt * dt / 2], [dt, 0], [0, dt]])
        P = F @ state["P"] @ F.T + self.drive**2 * G @ G.T
        return {**state, "time": scan.time, "x": state["x"] @ F.T, "P": P}

    def points(self, scan):
        """Positions ``(D, 2)`` of the detections, and their covariances."""
        z, R = scan.measurement, scan.noise_covariance
        sx, sy, yaw = scan.sensor_pose
        if scan.kind == "radar":
            angle = z[1] + yaw
            points = np.stack([sx + z[0] * np.cos(angle), sy + z[0] * np.sin(angle)], axis=-1)
            along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            across = np.stack([-np.sin(angle), np.cos(angle)], axis=-1) * z[0][:, None]
            spread = R[0, 0] * along[:, :, None] * along[:, None] + R[1, 1] * across[:, :, None] * across[:, None]
            return points, spread
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return [sx, sy] + z.T @ turn.T, np.broadcast_to(turn @ R @ turn.T, (z.shape[1], 2, 2))

    def squared(self, state, points, spread):
        """``(K, D)`` distances of predicted and measured positions."""
        S = state["P"][:, None, :2, :2] + spread
        y = points - state["x"][:, None, :2]
        return np.einsum("kdi,kdij,kdj->kd", y, np.linalg.inv(S), y), y, S

    def pairs(self, state, points, spread):
        """``(track, detection)`` from the nearest to the farthest, each used once."""
        d2 = self.squared(state, points, spread)[0]
        found = []
        while d2.size and d2.min() < self.gate**2:
            k, j = np.unravel_index(np.argmin(d2), d2.shape)
            found.append((int(k), int(j)))
            d2[k, :] = d2[:, j] = np.inf
        return found

    def updated(self, state, points, spread, pairs, scan):
        x, P, score, seen = (state[key].copy() for key in ("x", "P", "score", "seen"))
        d2, y, S = self.squared(state, points, spread)
        chance = scan.detection_probability
        missed = np.ones(len(x), dtype=bool)
        for k, j in pairs:
            K = P[k][:, :2] @ np.linalg.inv(S[k, j])
            x[k] += K @ y[k, j]
            P[k] -= K @ S[k, j] @ K.T
            likelihood = np.exp(-d2[k, j] / 2) / np.sqrt(np.linalg.det(2 * np.pi * S[k, j]))
            score[k] += np.log(chance * likelihood / self.clutter(scan))
            seen[k], missed[k] = scan.time, False
        score[missed] += self.lost(chance)
        return {**state, "x": x, "P": (P + P.swapaxes(1, 2)) / 2, "score": np.minimum(score, self.best), "seen": seen}

    def lost(self, chance):
        return np.log(max(1 - chance, 1e-3))

    def clutter(self, scan):
        """False alarms a square metre, over a disc of 150 m: radar and lidar tell them per volume of their own."""
        return 2.0 / (np.pi * 150.0**2)

    def managed(self, state, points, spread, pairs, scan):
        old = self.lasting(state, scan)
        state = {key: value if key == "time" else value[old] for key, value in state.items()}
        new = self.beginning(points, {j for _, j in pairs})
        x, P = np.zeros((len(new), 4)), np.zeros((len(new), 4, 4))
        for row, j in enumerate(new):
            x[row, :2], P[row, :2, :2] = points[j], spread[j]
            P[row, 2, 2] = P[row, 3, 3] = self.speed**2
            if scan.kind == "radar":
                away = points[j] - scan.sensor_pose[:2]
                x[row, 2:] = scan.measurement[2, j] * away / np.linalg.norm(away)
        state["x"], state["P"] = np.concatenate([state["x"], x]), np.concatenate([state["P"], P])
        state["score"] = np.concatenate([state["score"], np.zeros(len(new))])
        state["seen"] = np.concatenate([state["seen"], np.full(len(new), scan.time)])
        state["id"] = self.identities(np.concatenate([state["id"], np.full(len(new), -1)]), state["score"])
        return state

    def lasting(self, state, scan):
        return (state["score"] > self.delete) & (scan.time - state["seen"] < self.patience)

    def beginning(self, points, taken):
        return [j for j in range(len(points)) if j not in taken]

    def identities(self, ids, score):
        fresh = np.flatnonzero((ids < 0) & (score >= self.confirm))
        ids[fresh] = self.issued + np.arange(len(fresh))
        self.issued += len(fresh)
        return ids

    def output(self, state):
        shown = state["id"] >= 0
        return state, (state["id"][shown], state["x"][shown].T, np.moveaxis(state["P"][shown], 0, -1))
