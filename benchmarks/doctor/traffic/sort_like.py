"""Tracking by detection as in computer vision: noise of its own, hits in a row, an age limit; plain NumPy."""

from __future__ import annotations

from itertools import count

import numpy as np
from scipy.optimize import linear_sum_assignment

STEP = 0.05
#: Standard deviations that it reckons with, by the kind of sensor: m, and m and rad.
SIGMAS = {"lidar": (0.2, 0.2), "radar": (0.4, np.deg2rad(0.65))}
H = np.eye(2, 4)


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


class Point:
    """A detected position in the fixed frame, and its covariance."""

    def __init__(self, scan, column):
        x, y, yaw = scan.sensor_pose
        z, S = scan.measurement[:2, column], np.diag(SIGMAS[scan.kind]) ** 2
        turn = rotation(yaw)
        if scan.kind == "radar":
            r, turn = z[0], rotation(yaw + z[1])
            z, S = np.array([r, 0.0]), np.diag([1, r]) @ S @ np.diag([1, r])
        self.z, self.R = np.array([x, y]) + turn @ z, turn @ S @ turn.T


class KalmanBox:
    def __init__(self, point, time):
        self.mean = np.array([*point.z, 0.0, 0.0])
        self.covariance = np.diag([0.25, 0.25, 150.0, 150.0])
        self.time, self.streak, self.age, self.label = time, 1, 0, None

    def predict(self, time):
        dt = time - self.time
        F = np.eye(4) + dt * np.eye(4, k=2)
        self.mean = F @ self.mean
        self.covariance = F @ self.covariance @ F.T + dt * np.diag([0.05, 0.05, 8.0, 8.0])
        self.time = time

    def distance(self, point):
        S = self.covariance[:2, :2] + point.R
        y = point.z - self.mean[:2]
        return float(np.sqrt(y @ np.linalg.solve(S, y)))

    def update(self, point):
        K = self.covariance @ H.T @ np.linalg.inv(H @ self.covariance @ H.T + point.R)
        self.mean = self.mean + K @ (point.z - self.mean[:2])
        A = np.eye(4) - K @ H
        self.covariance = A @ self.covariance @ A.T + K @ point.R @ K.T


class SortLike:
    def __init__(self, min_hits=3, max_age=12, max_distance=4.0):
        self.min_hits, self.max_age, self.max_distance = min_hits, max_age, max_distance
        self.boxes, self.labels = [], count()

    def step(self, state, scan):
        points = self.points(scan)
        for box in self.boxes:
            box.predict(scan.time)
        pairs = self.match(points)
        for i, j in pairs:
            self.boxes[i].update(points[j])
            self.boxes[i].streak, self.boxes[i].age = self.boxes[i].streak + 1, 0
        matched = {i for i, _ in pairs}
        for i, box in enumerate(self.boxes):
            if i not in matched:
                self.unmatched(box)
        self.boxes = [box for box in self.boxes if self.kept(box)]
        self.boxes += [KalmanBox(points[j], scan.time) for j in self.fresh(points, {j for _, j in pairs})]
        for box in self.boxes:
            if box.label is None and box.streak >= self.min_hits:
                box.label = self.label()
        return None, self.result()

    def points(self, scan):
        return [Point(scan, column) for column in range(scan.measurement.shape[1])]

    def match(self, points):
        if not self.boxes or not points:
            return []
        cost = np.array([[box.distance(z) for z in points] for box in self.boxes])
        rows, columns = linear_sum_assignment(np.minimum(cost, 2 * self.max_distance))
        return [(i, j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < self.max_distance]

    def unmatched(self, box):
        box.age += 1
        if box.label is None:
            box.streak = 0

    def kept(self, box):
        return box.streak > 0 and box.age <= self.max_age

    def fresh(self, points, taken):
        return [j for j in range(len(points)) if j not in taken]

    def label(self):
        return next(self.labels)

    def shown(self):
        return [box for box in self.boxes if box.label is not None]

    def result(self):
        shown = self.shown()
        return (
            np.array([box.label for box in shown], dtype=int),
            np.array([box.mean for box in shown]).reshape(-1, 4).T,
            np.array([box.covariance for box in shown]).reshape(-1, 4, 4).transpose(1, 2, 0),
        )


class InOrderOfBoxes(SortLike):
    """Each box takes the nearest point that is left."""

    def match(self, points):
        left, pairs = list(range(len(points))), []
        for i, box in enumerate(self.boxes):
            near = sorted((box.distance(points[j]), j) for j in left)
            if near and near[0][0] < self.max_distance:
                pairs.append((i, near[0][1]))
                left.remove(near[0][1])
        return pairs


class ForEachSensor:
    """Each sensor has its own tracks."""

    def __init__(self):
        self.trackers, self.last = {}, {}

    def step(self, state, scan):
        tracker = self.trackers.setdefault(scan.kind, SortLike())
        _, self.last[scan.kind] = tracker.step(None, scan)
        parts = list(self.last.items())
        ids = [2 * result[0] + (kind == "radar") for kind, result in parts]
        return None, (
            np.concatenate(ids),
            np.concatenate([result[1] for _, result in parts], axis=-1),
            np.concatenate([result[2] for _, result in parts], axis=-1),
        )


class AgeNotCounted(SortLike):
    def unmatched(self, box):
        if box.label is None:
            box.streak = 0


class RecycledLabels(SortLike):
    """Of a pool of sixteen, the first that is free."""

    def label(self):
        return min(set(range(16)) - {box.label for box in self.boxes})


class Frozen(SortLike):
    """Boxes are moved where there is something to match them with."""

    def step(self, state, scan):
        if scan.measurement.shape[1]:
            return super().step(state, scan)
        for box in self.boxes:
            self.unmatched(box)
        self.boxes = [box for box in self.boxes if self.kept(box)]
        return None, self.result()


class SeenAtOnce(SortLike):
    """Boxes have a label when they are made."""

    def fresh(self, points, taken):
        self.min_hits = 1
        return super().fresh(points, taken)


class PairsOfBoxes(SortLike):
    """Another box is made of a matched point whose box is young; boxes share points."""

    def match(self, points):
        pairs = []
        for i, box in enumerate(self.boxes):
            distances = [box.distance(z) for z in points]
            if distances and min(distances) < self.max_distance:
                pairs.append((i, int(np.argmin(distances))))
        return pairs

    def fresh(self, points, taken):
        old = {j for j in taken if any(box.streak > 5 and box.distance(points[j]) < 2 for box in self.boxes)}
        return [j for j in range(len(points)) if j not in old]
