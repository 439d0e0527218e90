"""Stone Soup's tracker of several objects by joint probabilistic data association, made of its own parts."""

import copy
from datetime import datetime, timedelta

import numpy as np
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator, SinglePointMeasurementInitiator
from stonesoup.models.base import ReversibleModel
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.tracker.simple import MultiTargetMixtureTracker
from stonesoup.types.angle import Bearing
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater


class Radar(CartesianToBearingRangeRate2D, ReversibleModel):
    """Stone Soup's radar, and the state at which a measurement starts a track."""

    def inverse_function(self, detection, **_):
        bearing, distance, rate = np.ravel(detection.state_vector).astype(float)
        distance = max(distance, 1.0)  # its range rate has no derivative at the sensor
        azimuth = bearing + float(self.rotation_offset[2, 0])
        sight = np.array([np.cos(azimuth), np.sin(azimuth)])
        (x, y), own = np.ravel(self.translation_offset) + distance * sight, np.ravel(self.velocity)
        vx, vy = sight * (rate + sight @ own)
        return StateVector([x, vx, y, vy])


class StoneSoupJpda:
    def __init__(self, noise_diff_coeff):
        transition = CombinedLinearGaussianTransitionModel([ConstantVelocity(noise_diff_coeff)] * 2)
        self.updater = ExtendedKalmanUpdater(measurement_model=None)
        self.hypothesiser = PDAHypothesiser(ExtendedKalmanPredictor(transition), self.updater, prob_gate=0.9999)
        prior = GaussianState([0, 0, 0, 0], np.diag([100, 400, 100, 400]))  # a velocity of up to about 40 m/s
        self.initiator = MultiMeasurementInitiator(
            prior,
            UpdateTimeDeleter(timedelta(seconds=0.25)),  # longer than the period of the lidar, which alone sees behind
            GNNWith2DAssignment(self.hypothesiser),
            self.updater,
            min_points=3,
            initiator=SinglePointMeasurementInitiator(prior, updater=self.updater),
        )
        self.associator, self.deleter = JPDAwithEHM2(self.hypothesiser), UpdateTimeDeleter(timedelta(seconds=1))

    def step(self, state, scan):
        tracks, tentative, numbers = state or (set(), set(), {})
        time = datetime(2000, 1, 1) + timedelta(seconds=scan.time)
        self.hypothesiser.prob_detect = scan.detection_probability
        self.hypothesiser.clutter_spatial_density = max(scan.clutter_density, 1e-9)
        self.initiator.holding_tracks = {copy.copy(track) for track in tentative}
        tracker = MultiTargetMixtureTracker(self.initiator, self.deleter, None, self.associator, self.updater)
        tracker._tracks = {copy.copy(track) for track in tracks}
        tracker.update_tracker(time, _detections(scan, time))
        new = sorted((track for track in tracker.tracks if track.id not in numbers), key=lambda track: [*track.mean])
        numbers = numbers | {track.id: len(numbers) + number for number, track in enumerate(new)}
        kept = sorted(tracker.tracks, key=lambda track: numbers[track.id])
        order = [0, 2, 1, 3]  # from x, vx, y, vy
        mean = np.array([np.ravel(track.mean)[order] for track in kept]).reshape(-1, 4).T
        covariance = np.array([track.covar[np.ix_(order, order)] for track in kept]).reshape(-1, 4, 4)
        ids = np.array([numbers[track.id] for track in kept], dtype=int)
        return (tracker.tracks, self.initiator.holding_tracks, numbers), (ids, mean, np.moveaxis(covariance, 0, -1))


def _detections(scan, time):
    """Return the detections of a scan, which share one model of the sensor."""
    (x, y, yaw), z, R = scan.sensor_pose, scan.measurement, scan.noise_covariance
    if scan.kind == "radar":
        place, axes, velocity = StateVector([x, y]), StateVector([0, 0, yaw]), StateVector(scan.sensor_velocity)
        noise, columns = R[np.ix_([1, 0, 2], [1, 0, 2])], [[Bearing(angle), r, rate] for r, angle, rate in z.T]
        model = Radar(4, (0, 2), noise, translation_offset=place, rotation_offset=axes, velocity=velocity)
    else:  # a linear model has no pose: the measurements are turned into the fixed frame
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        columns, noise = [x, y] + z.T @ turn.T, turn @ R @ turn.T
        model = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=noise)
    return {Detection(StateVector(column), time, measurement_model=model) for column in columns}
