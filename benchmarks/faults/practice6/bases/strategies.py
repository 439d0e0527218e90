"""A tracker put together from exchangeable parts: predictor, updater, hypothesiser, associator, initiator, deleter."""

from abc import ABC, abstractmethod

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2


class State:
    def __init__(self, mean, covar, timestamp):
        self.mean, self.covar, self.timestamp = mean, covar, timestamp


class Track:
    def __init__(self, state):
        self.state = state
        self.hits = 1
        self.last_hit = state.timestamp
        self.id = None


class Predictor:
    def __init__(self, noise_diff_coeff):
        self.noise_diff_coeff = noise_diff_coeff

    def predict(self, prior, timestamp):
        dt = timestamp - prior.timestamp
        F = np.kron([[1.0, dt], [0.0, 1.0]], np.eye(2))
        Q = np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], self.noise_diff_coeff * np.eye(2))
        return State(F @ prior.mean, F @ prior.covar @ F.T + Q, timestamp)


class MeasurementModel(ABC):
    def __init__(self, scan):
        self.offset, self.yaw, self.velocity = scan.sensor_pose[:2], scan.sensor_pose[2], scan.sensor_velocity
        self.noise_covar = scan.noise_covariance

    @abstractmethod
    def function(self, mean): ...

    @abstractmethod
    def jacobian(self, mean): ...

    @abstractmethod
    def inverse_function(self, z):
        """The place, and its derivative by the first two components."""

    def innovation(self, z, mean):
        return z - self.function(mean)


class Cartesian(MeasurementModel):
    @property
    def rotation(self):
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, -s], [s, c]])

    def function(self, mean):
        return self.rotation.T @ (mean[:2] - self.offset)

    def jacobian(self, mean):
        return np.hstack([self.rotation.T, np.zeros((2, 2))])

    def inverse_function(self, z):
        return self.offset + self.rotation @ z, self.rotation


class RangeBearingRate(MeasurementModel):
    def function(self, mean):
        dx, dy = mean[:2] - self.offset
        ux, uy = mean[2:] - self.velocity
        r = np.hypot(dx, dy)
        return np.array([r, np.arctan2(dy, dx) - self.yaw, (dx * ux + dy * uy) / r])

    def jacobian(self, mean):
        dx, dy = mean[:2] - self.offset
        ux, uy = mean[2:] - self.velocity
        r = np.hypot(dx, dy)
        w = (dx * uy - dy * ux) / r**3
        return np.array(
            [[dx / r, dy / r, 0, 0], [-dy / r**2, dx / r**2, 0, 0], [-dy * w, dx * w, dx / r, dy / r]], dtype=float
        )

    def innovation(self, z, mean):
        y = z - self.function(mean)
        y[1] = (y[1] + np.pi) % (2 * np.pi) - np.pi
        return y

    def inverse_function(self, z):
        a = self.yaw + z[1]
        e = np.array([np.cos(a), np.sin(a)])
        return self.offset + z[0] * e, np.column_stack([e, z[0] * np.array([-e[1], e[0]])])


class Updater:
    def innovation(self, prediction, z, model):
        H = model.jacobian(prediction.mean)
        return model.innovation(z, prediction.mean), H @ prediction.covar @ H.T + model.noise_covar, H

    def update(self, prediction, z, model):
        y, S, H = self.innovation(prediction, z, model)
        K = np.linalg.solve(S, H @ prediction.covar).T
        covar = prediction.covar - K @ S @ K.T
        return State(prediction.mean + K @ y, (covar + covar.T) / 2, prediction.timestamp)


class Hypothesiser:
    """Distances of a prediction to all detections, infinite beyond the gate."""

    def __init__(self, updater, gate_probability):
        self.updater, self.gate_probability = updater, gate_probability

    def hypothesise(self, prediction, detections, model):
        distances = np.full(len(detections), np.inf)
        for j, z in enumerate(detections):
            y, S, _ = self.updater.innovation(prediction, z, model)
            d2 = y @ np.linalg.solve(S, y)
            if d2 < chi2.ppf(self.gate_probability, len(y)):
                distances[j] = d2 + np.linalg.slogdet(S)[1]
        return distances


class GlobalNearestNeighbour:
    missed = 1e4

    def associate(self, distances):
        """Pairs of a track's and a detection's index."""
        cost = np.where(np.isfinite(distances), distances, self.missed)
        rows, columns = linear_sum_assignment(cost)
        return [(i, j) for i, j in zip(rows, columns, strict=True) if np.isfinite(distances[i, j])]


class Initiator:
    min_hits = 3
    velocity_sigma = 20.0

    def __init__(self):
        self.given = 0

    def initiate(self, z, model, timestamp):
        place, J = model.inverse_function(z)
        covar = self.velocity_sigma**2 * np.diag([0.0, 0.0, 1.0, 1.0])
        covar[:2, :2] = J @ model.noise_covar[:2, :2] @ J.T
        return Track(State(np.append(place, [0.0, 0.0]), covar, timestamp))

    def confirm(self, track):
        if track.id is None and track.hits >= self.min_hits:
            track.id = self.given
            self.given += 1


class Deleter:
    def __init__(self, tentative, confirmed):
        self.tentative, self.confirmed = tentative, confirmed

    def delete(self, track, timestamp):
        return timestamp - track.last_hit > (self.tentative if track.id is None else self.confirmed)


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.predictor = Predictor(3.0)
        self.updater = Updater()
        self.hypothesiser = Hypothesiser(self.updater, 0.9995)
        self.associator = GlobalNearestNeighbour()
        self.initiator = Initiator()
        self.deleter = Deleter(0.25, 0.9)
        self.tracks = []

    def step(self, state, scan):
        model = (RangeBearingRate if scan.kind == "radar" else Cartesian)(scan)
        detections = list(scan.measurement.T)
        for track in self.tracks:
            track.state = self.predictor.predict(track.state, scan.time)
        used = set()
        if self.tracks and detections:
            distances = [self.hypothesiser.hypothesise(t.state, detections, model) for t in self.tracks]
            for i, j in self.associator.associate(np.array(distances)):
                track = self.tracks[i]
                track.state = self.updater.update(track.state, detections[j], model)
                track.hits += 1
                track.last_hit = scan.time
                self.initiator.confirm(track)
                used.add(j)
        self.tracks = [t for t in self.tracks if not self.deleter.delete(t, scan.time)]
        for j, z in enumerate(detections):
            if j not in used:
                self.tracks.append(self.initiator.initiate(z, model, scan.time))
        return None, self.estimate()

    def estimate(self):
        shown = [t for t in self.tracks if t.id is not None]
        if not shown:
            return None
        ids = np.array([t.id for t in shown])
        return ids, np.column_stack([t.state.mean for t in shown]), np.dstack([t.state.covar for t in shown])
