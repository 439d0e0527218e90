import numpy as np
from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.updater.kalman import ExtendedKalmanUpdater


def make_pair(q=0.5):
    transition = CombinedLinearGaussianTransitionModel([ConstantVelocity(q), ConstantVelocity(q)])  # x, vx, y, vy
    return ExtendedKalmanPredictor(transition), ExtendedKalmanUpdater(measurement_model=None)


radar = CartesianToBearingRangeRate2D(
    ndim_state=4, mapping=(0, 2), velocity_mapping=(1, 3), noise_covar=np.diag([0.01, 0.3, 0.1]) ** 2
)
