"""Motion models against finite differences, numerical integration and simulation."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import spherical_jn
from tests.support.scenes import NOISE

from trackbench.base.types import Gaussian
from trackbench.models.motion import (
    MOTION_MODELS,
    ConstantTurnRateVelocity,
    InitialSigmas,
    Kinematics,
    process_noise_covariance,
    turning,
)
from trackbench.models.motion.base import UNKNOWN_ANGLE
from trackbench.models.motion.ct import Turn
from trackbench.models.motion.singer import Singer

MODELS = {name: cls(**NOISE[name]) for name, cls in MOTION_MODELS.loaded().items()}
#: With noise that is constant over a step, which may be integrated as such.
STEPWISE = {name: model for name, model in MODELS.items() if name not in ("singer", "cv_continuous")}
TURNING = ("ctrv", "ctra")

every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
stepwise_models = pytest.mark.parametrize("model", STEPWISE.values(), ids=STEPWISE)
turning_models = pytest.mark.parametrize("model", [MODELS[name] for name in TURNING], ids=TURNING)

#: Of the components of any state, by their name or its first letter, the largest size.
LARGEST = {"p": 200.0, "v": 40.0, "a": 5.0, "yaw": np.pi, "slip": 0.3, "yaw_rate": 2.0}
#: Yaw rates around zero, and around the switch to the series.
YAW_RATES = [0.0, 1e-300, -1e-12, 1e-6, 0.01, 0.02, -0.02]
INTERVALS = [0.0, 0.05, 1.0, *np.random.default_rng(0).uniform(0.0, 2.0, 5)]
SIZE = 60


def drawn(name: str, random: np.random.Generator) -> np.ndarray:
    """``(60,)`` values of a component, with both signs; some are small, some zero, and some at the ends."""
    largest = LARGEST[name if name in LARGEST else name[0]]
    values = random.uniform(-largest, largest, SIZE)
    values[::5] *= 0.025
    values[1::10] = random.choice([0.0, largest, -largest, 5e-324, 1e-9], SIZE // 10)
    if name == "yaw_rate":
        values[2::5] = random.choice(YAW_RATES, SIZE // 5)
    return values


def states(model, seed: int = 0) -> np.ndarray:
    """``(n, 60)``"""
    random = np.random.default_rng(seed)
    return np.stack([drawn(name, random) for name in model.components])


def finite_difference(function, x: np.ndarray, size: float = 1e-3) -> np.ndarray:
    """Five-point derivative of ``function`` at states ``(n, ...)``."""
    columns = []
    for i in range(len(x)):
        step = np.zeros_like(x)
        step[i] = size
        values = [function(x + k * step) for k in (-2, -1, 1, 2)]
        columns.append((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * size))
    return np.stack(columns, axis=1)


def rate(model, x: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Time derivative of a state under constant driving noise, from the definition of each model."""
    if isinstance(model, Turn):
        return np.array([x[2], x[3], noise[0] - x[4] * x[3], noise[1] + x[4] * x[2], *noise[2:]])
    if isinstance(model, Singer):
        return np.concatenate([x[2:], -x[4:] / model.time_constant_s])
    if model.components[2] == "v":
        a, w = (x[5] if len(x) > 5 else noise[0]), x[4]
        last = [noise[1]] if len(x) == 5 else [noise[1], noise[0]]
        return np.array([x[2] * np.cos(x[3]), x[2] * np.sin(x[3]), a, w, *last])
    return np.concatenate([x[2:], noise[:2]])


def integrated(model, x: np.ndarray, noise: np.ndarray, dt: float) -> np.ndarray:
    """Of states ``(n, ...)`` under noise ``(q, ...)``."""
    if dt == 0:
        return x

    def slope(_: float, s: np.ndarray) -> np.ndarray:
        return rate(model, s.reshape(x.shape), noise).ravel()

    # Where both orders are without error SciPy divides nothing by nothing.
    with np.errstate(invalid="ignore"):
        done = solve_ivp(slope, (0, dt), x.ravel(), method="DOP853", rtol=1e-11, atol=1e-11)
    return done.y[:, -1].reshape(x.shape)


def test_spherical_bessel_functions_agree_with_scipy_on_both_sides_of_the_switch_to_the_series():
    small = np.concatenate([np.logspace(-12, 0.5, 400), [0.0, turning.SMALL, np.nextafter(turning.SMALL, 0)]])
    h = np.concatenate([small, -small])
    np.testing.assert_allclose(turning.bessel0(h), np.sinc(h / np.pi), rtol=1e-14)
    # Beyond the switch j1 is a difference of near-equal terms, over h and again over h for the slope.
    np.testing.assert_allclose(turning.bessel1(h), np.sign(h) * spherical_jn(1, np.abs(h)), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(turning.bessel1_slope(h), spherical_jn(1, np.abs(h), derivative=True), atol=1e-9)


def each(matrix: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A matrix of each state, also where it is the same for all."""
    return np.broadcast_to(matrix[..., None] if matrix.ndim == 2 else matrix, (*matrix.shape[:2], x.shape[-1]))


@every_model
@pytest.mark.parametrize("dt", INTERVALS)
def test_jacobians_agree_with_finite_differences(model, dt):
    x = states(model)
    expected = finite_difference(lambda s: model.transition(s, dt), x)
    np.testing.assert_allclose(each(model.jacobian(x, dt), x), expected, atol=1e-8)
    expected = finite_difference(model.to_cartesian, x)
    np.testing.assert_allclose(each(model.cartesian_jacobian(x), x), expected, atol=1e-8)


@every_model
@pytest.mark.parametrize("dt", INTERVALS)
def test_transition_agrees_with_numerical_integration(model, dt):
    x = states(model)
    expected = integrated(model, x, np.zeros((len(model.noise_sigma), SIZE)), dt)
    np.testing.assert_allclose(model.transition(x, dt), expected, atol=1e-7)


@stepwise_models
@pytest.mark.parametrize("driver", [0, 1, 2])
@pytest.mark.parametrize("dt", [0.05, 0.7, 2.0])
def test_noise_gain_is_what_constant_driving_noise_adds(model, driver, dt):
    # At rest the gain of the turning models, which takes the heading at the start, is exact.
    x = np.zeros(len(model.components))
    x[:2] = 3.0, -4.0
    if model.components[2] == "v":
        x[3] = 2.0
    noise = np.zeros(len(model.noise_sigma))
    noise[min(driver, len(noise) - 1)] = 1.3
    expected = integrated(model, x, noise, dt) - x
    np.testing.assert_allclose(model.noise_gain(x, dt) @ noise, expected, atol=1e-9)


def test_process_noise_of_constant_velocity_in_closed_form():
    dt, q = 0.4, NOISE["cv"]["acceleration_sigma_mps2"] ** 2
    axis = q * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
    np.testing.assert_allclose(
        process_noise_covariance(MODELS["cv"], np.zeros(4), dt), np.kron(axis, np.eye(2)), rtol=1e-14
    )


@every_model
def test_kinematics_become_the_state_of_that_motion(model):
    random = np.random.default_rng(1)
    numbers = [drawn(name, random) for name in ("p", "p", "v", "yaw", "a", "yaw_rate")]
    x = model.from_kinematics(Kinematics(*numbers))
    px, py, v, course, a, w = numbers
    expected = [px, py, v * np.cos(course), v * np.sin(course)]
    np.testing.assert_allclose(model.to_cartesian(x), expected, atol=1e-12)
    if len(x) == 6:
        # The second derivative of the position is the acceleration along and across the course.
        size, steps = 1e-3, (-2, -1, 1, 2)
        values = [model.to_cartesian(model.transition(x, k * size))[2:] for k in steps]
        velocity = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * size)
        c, s = np.cos(course), np.sin(course)
        np.testing.assert_allclose(velocity, [a * c - v * w * s, a * s + v * w * c], atol=1e-7)


@every_model
def test_a_cartesian_belief_survives_the_way_into_a_state_and_back(model):
    random = np.random.default_rng(2)
    speed, course = random.uniform(2, 40, SIZE), drawn("yaw", random)
    mean = np.stack([np.full(SIZE, 10.0), np.full(SIZE, -20.0), speed * np.cos(course), speed * np.sin(course)])
    root = random.normal(size=(SIZE, 4, 4)) * 0.01
    covariance = np.moveaxis(root @ np.swapaxes(root, 1, 2) + 1e-4 * np.eye(4), 0, -1)
    belief = model.from_cartesian(Gaussian(mean, covariance), InitialSigmas(acceleration=2.0, yaw_rate=0.1))
    back = model.cartesian_belief(belief)
    np.testing.assert_allclose(back.mean, mean, atol=1e-9)
    np.testing.assert_allclose(back.covariance, covariance, rtol=1e-2, atol=1e-6)
    assert np.linalg.eigvalsh(np.moveaxis(belief.covariance, -1, 0)).min() > 0


@turning_models
def test_a_belief_at_rest_knows_nothing_of_the_course(model):
    at_rest = Gaussian(np.array([1.0, 2.0, 0.0, 0.0]), np.diag([0.1, 0.1, 400.0, 400.0]))
    belief = model.from_cartesian(at_rest, InitialSigmas(acceleration=2.0, yaw_rate=0.1))
    assert np.isfinite(belief.covariance).all()
    assert np.sqrt(belief.covariance[3, 3]) == pytest.approx(UNKNOWN_ANGLE)
    assert np.linalg.eigvalsh(model.cartesian_belief(belief).covariance).min() > 0


@turning_models
@pytest.mark.parametrize("speed", [0.0, 0.5, -3.0, 20.0])
def test_cartesian_belief_is_that_of_samples(model, speed):
    random = np.random.default_rng(3)
    size = len(model.components)
    mean = np.zeros(size)
    mean[:5] = 4.0, -3.0, speed, 2.5, 0.1
    root = random.normal(size=(size, size)) * 0.1
    root[3] *= 0.5
    covariance = root @ root.T
    samples = random.multivariate_normal(mean, covariance, 400_000).T
    expected = np.cov(model.to_cartesian(samples))
    found = model.cartesian_belief(Gaussian(mean, covariance))
    np.testing.assert_allclose(found.mean, model.to_cartesian(mean), atol=1e-12)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((found.covariance - expected) / scale).max() < 0.03


@every_model
def test_batches_of_any_shape_give_what_single_states_give(model):
    x = np.random.default_rng(1).normal(size=(len(model.components), 2, 3))
    single = [[(i, j), x[:, i, j]] for i in range(2) for j in range(3)]
    for name in ("transition", "jacobian", "noise_gain"):
        found = getattr(model, name)(x, 0.3)
        for (i, j), state in single:
            expected = getattr(model, name)(state, 0.3)
            here = found[..., i, j] if found.ndim == expected.ndim + 2 else found
            np.testing.assert_allclose(here, expected, rtol=1e-13, atol=1e-13)


@turning_models
@pytest.mark.parametrize("speed", [0.0, 1e-16, 1e-9, 1e-4, 1e-2])
def test_the_speed_of_a_body_nearly_at_rest_is_as_uncertain_as_its_velocity(model, speed):
    belief = Gaussian(np.array([1.0, 2.0, 0.6 * speed, 0.8 * speed]), np.diag([1.0, 1.0, 4.0, 4.0]))
    found = model.from_cartesian(belief, InitialSigmas(1.0, 0.2))
    np.testing.assert_allclose(found.covariance[2, 2], 4.0, rtol=1e-12)
    np.testing.assert_allclose(found.covariance[3, 3], UNKNOWN_ANGLE**2, rtol=1e-12)


@pytest.mark.parametrize("sigma", [0.05, 0.5, 1.5])
def test_moments_of_position_and_velocity_hold_for_any_sigma_of_the_yaw(sigma: float) -> None:
    """Against quadrature over all four components."""
    motion = ConstantTurnRateVelocity(acceleration_sigma_mps2=1.0, yaw_acceleration_sigma_radps2=1.0)
    mean = np.array([3.0, -2.0, 9.0, 0.7, 0.2])
    spread = np.diag([1.0, 0.5, 2.0, sigma, 0.1])
    mix = np.eye(5) + 0.4 * np.tri(5, k=-1)
    factor = spread @ mix / np.sqrt((mix**2).sum(axis=1))[:, None]
    nodes, weights = np.polynomial.hermite_e.hermegauss(20)
    grid = np.stack(np.meshgrid(*[nodes] * 4, indexing="ij")).reshape(4, -1)
    weight = np.prod(np.meshgrid(*[weights / weights.sum()] * 4, indexing="ij"), axis=0).ravel()
    # The lower factor: the first four components need the first four numbers.
    points = motion.to_cartesian(mean[:, None] + factor[:, :4] @ grid)
    expected = points @ weight
    away = points - expected[:, None]
    found = motion.cartesian_moments(Gaussian(mean[:, None], (factor @ factor.T)[..., None]))
    np.testing.assert_allclose(found.mean[:, 0], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.covariance[..., 0], (away * weight) @ away.T, rtol=1e-8, atol=1e-8)
