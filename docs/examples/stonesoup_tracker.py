from datetime import datetime, timedelta

import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.types.angle import Bearing
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater


class StoneSoupEkf:
    def __init__(self, noise_diff_coeff=0.5):
        transition = CombinedLinearGaussianTransitionModel([ConstantVelocity(noise_diff_coeff)] * 2)
        self.predictor = ExtendedKalmanPredictor(transition)
        self.updater = ExtendedKalmanUpdater(measurement_model=None)

    def step(self, state, scan):
        (x, y, yaw), z, R = scan.sensor_pose, scan.measurement, scan.noise_covariance
        time = datetime(2000, 1, 1) + timedelta(seconds=scan.time)
        if scan.kind == "radar":
            position = x + z[0] * np.cos(yaw + z[1]), y + z[0] * np.sin(yaw + z[1])
            measured, R = [Bearing(z[1]), z[0], z[2]], R[np.ix_([1, 0, 2], [1, 0, 2])]
            place, axes, velocity = StateVector([x, y]), StateVector([0, 0, yaw]), StateVector(scan.sensor_velocity)
            model = CartesianToBearingRangeRate2D(
                4, (0, 2), R, translation_offset=place, rotation_offset=axes, velocity_mapping=(1, 3), velocity=velocity
            )
        else:  # a linear model has no pose: the measurement is turned into the fixed frame
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            measured = position = [x, y] + turn @ z
            model = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=turn @ R @ turn.T)
        if state is None:  # the first measurement, and a velocity of up to about 40 m/s
            mean, covar = StateVector([position[0], 0, position[1], 0]), np.diag([1, 400, 1, 400])
        else:
            track = self.predictor.predict(state, timestamp=time)
            if scan.valid:
                track = self.updater.update(SingleHypothesis(track, Detection(measured, time, measurement_model=model)))
            mean, covar = track.mean, track.covar
        state = GaussianState(mean, covar, timestamp=time)  # an update would hold the whole past
        order = [0, 2, 1, 3]  # from x, vx, y, vy
        return state, (np.ravel(mean)[order], covar[np.ix_(order, order)])
