"""The IMM case of the EKF/UKF toolbox: Hartikainen, Solin and Särkkä (2011), its demonstration `imm_demo`.

Known of it is the program: models, noises, chain, prior and the steps at which the motion switches. The trajectory and
the measurements of the published figure are random draws that were not kept, so that one figure of ours among many
draws is held against it.
"""

import numpy as np
import pytest
from tests.support.reference import smoothed
from tests.support.scenes import scan

from trackbench.base.types import Gaussian
from trackbench.filters import InteractingMultipleModel, KalmanFilter
from trackbench.models.motion import ConstantAcceleration, ConstantVelocity

DT, STEPS, RUNS = 0.1, 200, 200
#: Of the acceleration of the model of constant velocity, and of the jerk of the other.
DENSITY = {4: 0.01, 6: 1.0}
VARIANCE = 0.1
START = np.array([0.0, 0.0, 0.0, -1.0, 0.0, 0.0])
PRIOR = np.diag([0.1, 0.1, 0.1, 0.1, 0.5, 0.5])
#: It stays with a model with probability .98 over a step, in continuous time for this long, s.
STAY = -2 * DT / np.log(2 * 0.98 - 1)
#: Mean square error of the position, m^2, of one draw.
PUBLISHED_IMM = 0.0229


def root_of_noise(size):
    """Of white noise in continuous time, over one step."""
    covariance = {
        4: np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]]),
        6: np.array(
            [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
        ),
    }[size]
    return np.kron(np.linalg.cholesky(DENSITY[size] * covariance), np.eye(2))


class WienerVelocity(ConstantVelocity):
    """The white noise is continuous, not constant over each step."""

    acceleration_sigma_mps2: float = 1.0

    @property
    def noise_sigma(self):
        return (1.0,) * 4

    def noise_gain(self, x, dt):
        return root_of_noise(4)


class WienerAcceleration(ConstantAcceleration):
    """The same of the jerk."""

    jerk_sigma_mps3: float = 1.0

    @property
    def noise_sigma(self):
        return (1.0,) * 6

    def noise_gain(self, x, dt):
        return root_of_noise(6)


VELOCITY, ACCELERATION = WienerVelocity(), WienerAcceleration()


def draws(seed):
    """True positions and measurements, each ``(200, 2, runs)``."""
    random = np.random.default_rng(seed)
    modes = np.repeat([4, 6, 4, 6, 4], [50, 20, 50, 30, 50])
    x = np.repeat(START[:, None], RUNS, axis=1)
    states = [x[:2]]
    for size in modes[1:]:
        motion = VELOCITY if size == 4 else ACCELERATION
        x[size:] = 0.0
        moved = motion.jacobian(x[:size], DT) @ x[:size] + root_of_noise(size) @ random.normal(size=(size, RUNS))
        x = np.concatenate([moved, x[size:]])
        states.append(x[:2])
    truth = np.stack(states)
    return truth, truth + np.sqrt(VARIANCE) * random.normal(size=truth.shape)


def mean_square_errors(filter, truth, measured):
    """``(2, runs)`` of the filter and of its smoother."""

    def prior(motion):
        size = len(motion.components)
        mean = np.repeat(START[:size, None], RUNS, axis=1)
        return Gaussian(mean, np.repeat(PRIOR[:size, :size, None], RUNS, axis=2))

    belief, beliefs = filter.begin(prior), []
    for k, measurement in enumerate(measured):
        said = scan("lidar", k * DT, measurement)._replace(noise_covariance=VARIANCE * np.eye(2))
        belief = filter.update(filter.predict(belief, DT), said).belief
        beliefs.append(belief)
    found = smoothed(filter, beliefs, [DT] * (STEPS - 1))
    errors = [np.stack([filter.cartesian(one).mean[:2] for one in each]) - truth for each in (beliefs, found)]
    return np.mean(np.square(errors), axis=(1, 2))


def test_the_published_error_is_one_of_those_that_the_draws_give():
    truth, measured = draws(seed=1)
    filters = {
        "cv": KalmanFilter(VELOCITY),
        "ca": KalmanFilter(ACCELERATION),
        "imm": InteractingMultipleModel((KalmanFilter(VELOCITY), KalmanFilter(ACCELERATION)), (STAY, STAY), (0.9, 0.1)),
    }
    errors = {name: mean_square_errors(filter, truth, measured) for name, filter in filters.items()}
    low, high = np.percentile(errors["imm"][0], [2.5, 97.5])
    assert low < PUBLISHED_IMM < high
    # The published draw is near the middle of what is possible.
    assert np.mean(errors["imm"][0]) == pytest.approx(PUBLISHED_IMM, rel=0.05)
    for k in (0, 1):
        assert np.all([np.mean(errors["imm"][k] < errors[name][k]) > 0.9 for name in ("cv", "ca")])
    assert all(np.all(after < before) for before, after in errors.values())
