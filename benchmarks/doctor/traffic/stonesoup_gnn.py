"""Stone Soup's global nearest neighbour as its documentation puts one together, on positions."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.types.update import Update
from stonesoup.updater.kalman import KalmanUpdater

BEGIN = datetime(2024, 1, 1)
#: Stone Soup's state is x, vx, y, vy.
ORDER = [0, 2, 1, 3]


class StoneSoupGnn:
    def __init__(self, missed_distance=4.0, min_points=3, deleted_after=0.8, intensity=4.0):
        motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(intensity)] * 2)
        self.predictor, self.updater = KalmanPredictor(motion), KalmanUpdater(None)
        hypothesiser = DistanceHypothesiser(
            self.predictor, self.updater, Mahalanobis(), missed_distance=missed_distance
        )
        self.associator = GNNWith2DAssignment(hypothesiser)
        self.deleter = UpdateTimeDeleter(timedelta(seconds=deleted_after), delete_last_pred=True)
        self.initiator = MultiMeasurementInitiator(
            GaussianState([0, 0, 0, 0], np.diag([0, 225, 0, 225])),
            UpdateTimeDeleter(timedelta(seconds=0.16)),
            self.associator,
            self.updater,
            min_points=min_points,
        )
        self.tracks = set()
        self.numbers = {}

    def step(self, state, scan):
        time = BEGIN + timedelta(seconds=scan.time)
        detections = self.detections(scan, time)
        found = self.associator.associate(self.tracks, set(detections), time)
        for track, hypothesis in found.items():
            track.append(self.updater.update(hypothesis) if hypothesis else hypothesis.prediction)
        self.tracks -= self.deleted(time)
        self.tracks |= self.initiator.initiate(self.unclaimed(detections, found), time)
        return None, self.answer(detections)

    def detections(self, scan, time):
        z, R, found = scan.measurement, scan.noise_covariance[:2, :2], []
        x, y, yaw = scan.sensor_pose
        for own in z[:2].T:
            polar = scan.kind == "radar"
            r, angle = (own[0], yaw + own[1]) if polar else (1.0, yaw)
            J = np.array([[np.cos(angle), -r * np.sin(angle)], [np.sin(angle), r * np.cos(angle)]])
            position = np.array([x, y]) + J @ ([r, 0.0] if polar else own)
            model = LinearGaussian(4, (0, 2), J @ R @ J.T)
            found.append(Detection(position[:, None], timestamp=time, measurement_model=model))
        return found

    def deleted(self, time):
        return self.deleter.delete_tracks(self.tracks, timestamp=time)

    def unclaimed(self, detections, found):
        return set(detections) - {hypothesis.measurement for hypothesis in found.values() if hypothesis}

    def number(self, track):
        return self.numbers.setdefault(track.id, len(self.numbers))

    def answer(self, detections=()):
        if not self.tracks:
            return None
        tracks = sorted(self.tracks, key=self.number)
        used = [
            detections.index(t.state.hypothesis.measurement) if detections and isinstance(t.state, Update) else -1
            for t in tracks
        ]
        return (
            np.array([self.number(track) for track in tracks]),
            np.stack([np.asarray(t.state_vector, dtype=float)[ORDER, 0] for t in tracks], axis=-1),
            np.stack([np.asarray(t.covar, dtype=float)[np.ix_(ORDER, ORDER)] for t in tracks], axis=-1),
            None,
            np.array(used),
        )


class StartsFromAll(StoneSoupGnn):
    """Detections that a track took are given to the initiator as well."""

    def unclaimed(self, detections, found):
        return set(detections)


class Numbered(StoneSoupGnn):
    """By their place among those that are there."""

    def number(self, track):
        return sorted(self.tracks, key=lambda one: (one.states[0].timestamp, one.id)).index(track)


class EmptySkipped(StoneSoupGnn):
    def step(self, state, scan):
        if scan.measurement.shape[1]:
            return super().step(state, scan)
        return None, self.answer()


class NeverDeleted(StoneSoupGnn):
    def deleted(self, time):
        return set()
