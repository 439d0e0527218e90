"""Joint probabilistic data association for confirmed tracks, nearest neighbours for those that begin."""

import numpy as np
from scipy.stats import chi2


def wrap_to_pi(a):
    return (a + np.pi) % (2 * np.pi) - np.pi


class Target:
    def __init__(self, x, P, time):
        self.x, self.P = x, P
        self.label = 0
        self.found, self.looked = 1, 1
        self.last = time


class Tracker:
    identities = "hidden"
    q = 3.0
    gate_probability = 0.999

    def __init__(self):
        self.targets, self.labels, self.time = [], 0, None

    def step(self, state, scan):
        dt = scan.time - self.time if self.time is not None else 0.0
        self.time = scan.time
        for target in self.targets:
            self.predict(target, dt)
        z = list(scan.measurement.T)
        free = self.joint([t for t in self.targets if t.label], z, scan)
        free = self.nearest([t for t in self.targets if not t.label], z, free, scan)
        self.targets = [t for t in self.targets if self.lives(t)]
        for j in sorted(free):
            self.targets.append(self.begin(z[j], scan))
        shown = [t for t in self.targets if t.label]
        if not shown:
            return None, None
        labels = np.array([t.label for t in shown])
        means = np.column_stack([t.x for t in shown])
        return None, (labels, means, np.dstack([t.P for t in shown]))

    def predict(self, target, dt):
        F = np.eye(4)
        F[:2, 2:] = np.eye(2) * dt
        L = np.vstack([np.eye(2) * dt**2 / 2, np.eye(2) * dt]) * self.q
        target.x = F @ target.x
        target.P = F @ target.P @ F.T + L @ L.T

    def expect(self, x, scan):
        dx, dy = x[:2] - scan.sensor_pose[:2]
        yaw = scan.sensor_pose[2]
        if scan.kind != "radar":
            c, s = np.cos(yaw), np.sin(yaw)
            H = np.array([[c, s, 0, 0], [-s, c, 0, 0]])
            return H[:, :2] @ [dx, dy], H
        ux, uy = x[2:] - scan.sensor_velocity
        r = np.hypot(dx, dy)
        spin = (ux * dy - uy * dx) / r**3
        H = np.array([[dx / r, dy / r, 0, 0], [-dy / r**2, dx / r**2, 0, 0], [dy * spin, -dx * spin, dx / r, dy / r]])
        return np.array([r, wrap_to_pi(np.arctan2(dy, dx) - yaw), (dx * ux + dy * uy) / r]), H

    def innovations(self, target, z, scan):
        """By the number of the detection: innovation and likelihood, of those in the gate; and H and S."""
        h, H = self.expect(target.x, scan)
        S = H @ target.P @ H.T + scan.noise_covariance
        Si = np.linalg.inv(S)
        limit = chi2.ppf(self.gate_probability, len(h))
        norm = 1.0 / np.sqrt(np.linalg.det(2 * np.pi * S))
        inside = {}
        for j, measured in enumerate(z):
            v = measured - h
            if scan.kind == "radar":
                v[1] = wrap_to_pi(v[1])
            d2 = v @ Si @ v
            if d2 < limit:
                inside[j] = v, norm * np.exp(-0.5 * d2)
        return inside, H, S

    def in_view(self, target, scan):
        d = target.x[:2] - scan.sensor_pose[:2]
        off = wrap_to_pi(np.arctan2(d[1], d[0]) - scan.sensor_pose[2])
        return np.hypot(*d) <= scan.field_of_view.max_range and abs(off) <= scan.field_of_view.half_angle

    def joint(self, targets, z, scan):
        """Updates the confirmed; returns which detections are in nobody's gate."""
        seen = [t for t in targets if self.in_view(t, scan)]
        gated = [self.innovations(t, z, scan) for t in seen]
        clutter = max(scan.clutter_density, 1e-9)
        pd, pg = scan.detection_probability, self.gate_probability
        beta = [dict.fromkeys([None, *inside], 0.0) for inside, _, _ in gated]

        def events(i, used, weight, chosen):
            if i == len(seen):
                for k, j in enumerate(chosen):
                    beta[k][j] += weight
                return
            events(i + 1, used, weight * (1 - pd * pg), [*chosen, None])
            for j, (_, likelihood) in gated[i][0].items():
                if j not in used:
                    events(i + 1, used | {j}, weight * pd * likelihood / clutter, [*chosen, j])

        events(0, frozenset(), 1.0, [])
        for target, weights, (inside, H, S) in zip(seen, beta, gated, strict=True):
            total = sum(weights.values())
            weights = {j: w / total for j, w in weights.items()}
            if inside:
                self.update(target, weights, inside, H, S)
            if 1 - weights[None] > 0.5:
                target.last = scan.time
        return set(range(len(z))) - {j for inside, _, _ in gated for j in inside}

    def update(self, target, weights, inside, H, S):
        W = target.P @ H.T @ np.linalg.inv(S)
        miss = weights[None]
        v = sum(weights[j] * inside[j][0] for j in inside)
        spread = -np.outer(v, v)
        for j in inside:
            spread = spread + weights[j] * np.outer(inside[j][0], inside[j][0])
        certain = target.P - W @ S @ W.T
        target.x = target.x + W @ v
        target.P = miss * target.P + (1 - miss) * certain + W @ spread @ W.T
        target.P = 0.5 * (target.P + target.P.T)

    def nearest(self, targets, z, free, scan):
        """The likeliest pairs of all first."""
        seen = [t for t in targets if self.in_view(t, scan)]
        gated = [self.innovations(t, z, scan) for t in seen]
        pairs = [(-inside[j][1], i, j) for i, (inside, _, _) in enumerate(gated) for j in inside if j in free]
        taken, left = set(), set(free)
        for target in seen:
            target.looked += 1
        for _, i, j in sorted(pairs):
            if i in taken or j not in left:
                continue
            taken.add(i)
            left.remove(j)
            target, (inside, H, S) = seen[i], gated[i]
            self.update(target, {None: 0.0, j: 1.0}, {j: inside[j]}, H, S)
            target.found += 1
            target.last = scan.time
            if target.found >= 3:
                self.labels += 1
                target.label = self.labels
        return left

    def lives(self, target):
        if target.label:
            return self.time - target.last < 1.0
        return target.looked - target.found <= 2 and self.time - target.last < 1.0

    def begin(self, m, scan):
        px, py, yaw = scan.sensor_pose
        R = scan.noise_covariance
        P = np.diag([0.0, 0.0, 30.0**2, 30.0**2])
        if scan.kind == "radar":
            a = yaw + m[1]
            e, n = np.array([np.cos(a), np.sin(a)]), np.array([-np.sin(a), np.cos(a)])
            J = np.column_stack([e, m[0] * n])
            P[:2, :2] = J @ R[:2, :2] @ J.T
            x = np.array([px, py, 0.0, 0.0])
            x[:2] += m[0] * e
            H = np.array([0.0, 0.0, *e])
            K = P @ H / (H @ P @ H + R[2, 2])
            x = x + K * (m[2] + e @ scan.sensor_velocity)
            P = P - np.outer(K, H @ P)
            P = (P + P.T) / 2
        else:
            T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            x = np.append(np.array([px, py]) + T @ m, [0.0, 0.0])
            P[:2, :2] = T @ R @ T.T
        return Target(x, P, scan.time)
