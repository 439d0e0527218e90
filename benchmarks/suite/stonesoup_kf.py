"""Stone Soup's Kalman filter at constant velocity on the positions of a lidar."""

from docs.examples.stonesoup_tracker import StoneSoupEkf
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.updater.kalman import KalmanUpdater


class StoneSoupKf(StoneSoupEkf):
    def __init__(self, noise_diff_coeff):
        super().__init__(noise_diff_coeff)
        self.predictor = KalmanPredictor(self.predictor.transition_model)
        self.updater = KalmanUpdater(measurement_model=None)
