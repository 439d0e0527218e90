"""Filters against closed forms and against textbook filters for one target."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from tests.support import reference
from tests.support.scenes import LIDAR_NOISE, NOISE, RADAR_NOISE, scan, tracker

from trackbench.filters import (
    CUBATURE,
    Belief,
    ExtendedKalmanFilter,
    IteratedExtendedKalmanFilter,
    KalmanFilter,
    SigmaPointFilter,
    SymmetricSet,
)
from trackbench.models.motion import MOTION_MODELS, process_noise_covariance
from trackbench.models.sensors import SENSOR_MODELS

MODELS = {name: cls(**NOISE[name]) for name, cls in MOTION_MODELS.loaded().items()}
every_model = pytest.mark.parametrize("motion", MODELS.values(), ids=MODELS)
linear_models = pytest.mark.parametrize("motion", [MODELS["cv"], MODELS["ca"]], ids=["cv", "ca"])

POSE, OWN = (-5.0, 3.0, 0.4), (6.0, -1.0)


def start(motion) -> Belief:
    """A target some 50 m ahead that moves at 12 m/s, and an ordinary uncertainty with correlations."""
    size = len(motion.components)
    mean = np.array([40.0, 20.0, 12.0, -3.0, 0.5, 0.3]) if motion.linear else np.array([40, 20, 12, 3.0, 0.2, 0.5])
    root = np.random.default_rng(7).normal(size=(size, size)) * np.array([0.6, 0.6, 0.5, 0.3, 0.2, 0.2])[:size, None]
    return Belief(mean[:size], root @ root.T + 0.01 * np.eye(size))


def scans(motion, steps: int = 30, dt: float = 0.1):
    """Alternating radar and lidar measurements of a target that moves as the model says, the course passing pi."""
    random = np.random.default_rng(11)
    x = start(motion).mean
    for k in range(steps):
        x = motion.transition(x, dt)
        kind, noise = ("radar", RADAR_NOISE) if k % 2 else ("lidar", LIDAR_NOISE)
        exact = SENSOR_MODELS[kind].measure(motion.to_cartesian(x), np.array(POSE), np.array(OWN))
        measurement = exact + random.multivariate_normal(np.zeros(len(noise)), noise)
        yield scan(kind, (k + 1) * dt, measurement, pose=POSE, velocity=OWN), dt


def observation(motion, kind: str):
    """h and its derivative as functions of the state."""
    sensor = SENSOR_MODELS[kind]

    def h(x):
        return sensor.measure(motion.to_cartesian(x), np.array(POSE), np.array(OWN))

    def slope(x):
        return sensor.jacobian(motion.to_cartesian(x), np.array(POSE), np.array(OWN)) @ motion.cartesian_jacobian(x)

    return h, slope


def assert_same(found, mean, covariance, angular=(), tolerance=1e-9):
    np.testing.assert_allclose(reference.residual(angular)(found.mean, mean), 0, atol=tolerance)
    np.testing.assert_allclose(found.covariance, covariance, atol=tolerance)


def test_scalar_kalman_filter_in_closed_form():
    # A target known to stand still: the variance of the mean of k measurements is r / k, the estimate their mean.
    motion = MOTION_MODELS["cv"].model_construct(acceleration_sigma_mps2=0.0)
    measurements = np.random.default_rng(0).normal(5.0, 2.0, size=(2, 10))
    noise = 4.0 * np.eye(2)
    belief = Belief(np.array([*measurements[:, 0], 0.0, 0.0]), np.diag([4.0, 4.0, 1e-30, 1e-30]))
    kalman = KalmanFilter(motion)
    for k in range(1, 10):
        belief = kalman.update(
            kalman.predict(belief, 0.1), scan("lidar", k * 0.1, measurements[:, k], noise=noise)
        ).belief
        np.testing.assert_allclose(belief.mean[:2], measurements[:, : k + 1].mean(axis=1), rtol=1e-12)
        np.testing.assert_allclose(np.diag(belief.covariance)[:2], 4.0 / (k + 1), rtol=1e-12)


@linear_models
@pytest.mark.parametrize("make", [KalmanFilter, ExtendedKalmanFilter], ids=["kf", "ekf"])
def test_steady_state_is_that_of_the_riccati_equation(make, motion):
    dt, size = 0.1, len(motion.components)
    belief, kalman = Belief(np.zeros(size), np.eye(size)), make(motion)
    for k in range(400):
        predicted = kalman.predict(belief, dt)
        belief = kalman.update(predicted, scan("lidar", k * dt, np.zeros(2))).belief
    f, h, q = motion.jacobian(belief.mean, dt), np.eye(2, size), process_noise_covariance(motion, belief.mean, dt)
    expected = solve_discrete_are(f.T, h.T, q, LIDAR_NOISE)
    np.testing.assert_allclose(predicted.covariance, expected, atol=1e-9)


@linear_models
def test_kalman_filter_is_the_textbook_one(motion):
    kalman, belief = KalmanFilter(motion), start(motion)
    x, p = belief.mean, belief.covariance
    h = np.eye(2, len(x))
    for seen, dt in scans(motion):
        position = SENSOR_MODELS[seen.kind].position(seen)
        f, q = motion.jacobian(x, dt), process_noise_covariance(motion, x, dt)
        x, p = reference.predict(x, p, lambda s, f=f: f @ s, f, q)
        innovation = position.mean - h @ x
        x, p, s = reference.update(x, p, innovation, h, position.covariance)
        result = kalman.update(kalman.predict(belief, dt), seen)
        belief = result.belief
        assert_same(belief, x, p)
        np.testing.assert_allclose(result.innovation, innovation, atol=1e-9)
        np.testing.assert_allclose(result.innovation_covariance, s, atol=1e-9)


@every_model
def test_extended_kalman_filter_is_the_textbook_one(motion):
    extended, belief = ExtendedKalmanFilter(motion), start(motion)
    x, p = belief.mean, belief.covariance
    for seen, dt in scans(motion):
        h, slope = observation(motion, seen.kind)
        f, q = motion.jacobian(x, dt), process_noise_covariance(motion, x, dt)
        x, p = reference.predict(x, p, lambda s, dt=dt: motion.transition(s, dt), f, q)
        innovation = reference.residual(SENSOR_MODELS[seen.kind].angular)(seen.measurement, h(x))
        x, p, s = reference.update(x, p, innovation, slope(x), seen.noise_covariance)
        result = extended.update(extended.predict(belief, dt), seen)
        belief = result.belief
        assert_same(belief, x, p, motion.angular)
        np.testing.assert_allclose(result.innovation, innovation, atol=1e-9)
        np.testing.assert_allclose(result.innovation_covariance, s, atol=1e-9)


@every_model
@pytest.mark.parametrize("augmented", [True, False], ids=["augmented", "additive"])
@pytest.mark.parametrize(
    "rule",
    [(1.0, 2.0, 0.0), (0.5, 2.0, 3.0), (1.0, 0.0, -1.0), (1.0, 0.0, 0.0)],
    ids=["scaled", "alpha 0.5", "negative centre", "cubature"],
)
def test_unscented_filter_is_the_textbook_one(motion, augmented, rule):
    unscented = SigmaPointFilter(motion, SymmetricSet(*rule), augmented)
    belief = start(motion)
    x, p = belief.mean, belief.covariance
    subtract = reference.residual(motion.angular)
    for seen, dt in scans(motion, steps=14):
        h, _ = observation(motion, seen.kind)
        x, p, points = reference.unscented_predict(
            x,
            p,
            lambda s, dt=dt: motion.transition(s, dt),
            lambda s, dt=dt: motion.noise_gain(s, dt),
            motion.noise_sigma,
            subtract,
            rule,
            augmented,
        )
        predicted = unscented.predict(belief, dt)
        assert_same(predicted, x, p, motion.angular)
        x, p, innovation, s = reference.unscented_update(
            x,
            p,
            points,
            seen.measurement,
            h,
            seen.noise_covariance,
            subtract,
            reference.residual(SENSOR_MODELS[seen.kind].angular),
            rule,
        )
        result = unscented.update(predicted, seen)
        belief = result.belief
        assert_same(belief, x, p, motion.angular)
        np.testing.assert_allclose(result.innovation, innovation, atol=1e-9)
        np.testing.assert_allclose(result.innovation_covariance, s, atol=1e-9)


@linear_models
def test_all_filters_are_one_on_a_linear_problem(motion):
    others = {
        "ekf": ExtendedKalmanFilter(motion),
        "scaled ukf": SigmaPointFilter(motion, SymmetricSet(0.7, 2.0, 1.0)),
        "classic ukf": SigmaPointFilter(motion, SymmetricSet(1.0, 0.0, None)),
        "additive ukf": SigmaPointFilter(motion, SymmetricSet(1.0, 2.0, 0.0), augmented=False),
        "ckf": SigmaPointFilter(motion, CUBATURE, augmented=False),
    }
    kalman, belief = KalmanFilter(motion), start(motion)
    beliefs = dict.fromkeys(others, belief)
    measurements = [(seen, dt) for seen, dt in scans(motion) if seen.kind == "lidar"]
    for seen, dt in measurements:
        expected = kalman.update(kalman.predict(belief, dt), seen)
        belief = expected.belief
        for name, other in others.items():
            result = other.update(other.predict(beliefs[name], dt), seen)
            beliefs[name] = result.belief
            assert_same(result.belief, belief.mean, belief.covariance)
            # The Kalman filter states the innovation in the fixed frame, the others in that of the sensor.
            c, s = np.cos(POSE[2]), np.sin(POSE[2])
            turn = np.array([[c, s], [-s, c]])
            np.testing.assert_allclose(result.innovation, turn @ expected.innovation, atol=1e-9)
            spread = turn @ expected.innovation_covariance @ turn.T
            np.testing.assert_allclose(result.innovation_covariance, spread, atol=1e-9)


def test_the_classic_rule_takes_three_minus_the_dimension():
    assert SymmetricSet(1.0, 0.0, None).weights(5) == pytest.approx((np.sqrt(3), (3 - 5) / 3, (3 - 5) / 3, 1 / 6))


def test_the_keys_of_a_scenario_choose_the_rule():
    made = tracker(filter="ukf", motion="ctrv", kappa=2.0, **NOISE["ctrv"]).filter
    assert made.rule == SymmetricSet(1.0, 2.0, 2.0)
    assert made.augmented
    made = tracker(filter="ukf", motion="ctrv", sigma_points="classic", augmented=False, **NOISE["ctrv"]).filter
    assert made.rule == SymmetricSet(1.0, 0.0, None)
    assert not made.augmented
    assert tracker(filter="ckf", motion="ca", **NOISE["ca"]).filter == SigmaPointFilter(MODELS["ca"], CUBATURE, False)


@every_model
def test_iterated_filter_finds_the_most_probable_state(motion):
    belief = start(motion)
    x, p = belief.mean, belief.covariance * 0.1
    h, slope = observation(motion, "radar")
    measurement = h(x) + np.array([0.8, 0.03, -0.6])
    expected = reference.most_probable(x, p, measurement, h, RADAR_NOISE, reference.residual((1,)))
    seen = scan("radar", 0.1, measurement, pose=POSE, velocity=OWN)
    found = IteratedExtendedKalmanFilter(motion, 50).update(Belief(x, p), seen)
    np.testing.assert_allclose(reference.residual(motion.angular)(found.belief.mean, expected), 0, atol=1e-6)
    # Its covariance is that of the linearisation at the estimate, its innovation that of the prediction.
    _, covariance, _ = reference.update(x, p, np.zeros(3), slope(expected), RADAR_NOISE)
    np.testing.assert_allclose(found.belief.covariance, covariance, atol=1e-5)
    first = ExtendedKalmanFilter(motion).update(Belief(x, p), seen)
    np.testing.assert_allclose(found.innovation, first.innovation, atol=1e-12)
    np.testing.assert_allclose(found.innovation_covariance, first.innovation_covariance, atol=1e-12)
