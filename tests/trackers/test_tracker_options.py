"""Options of the built-in trackers that state what is otherwise derived: process noise, first state, sensor model."""

import numpy as np
import pytest
from pydantic import ValidationError
from tests.support.places import SCENARIOS
from tests.support.scenes import NOISE, RADAR_NOISE, scan, tracker

from trackbench.base import linalg
from trackbench.base.config.messages import explain
from trackbench.models.motion import MOTION_MODELS, ConstantProcessNoise, Kinematics, process_noise_covariance
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.config import FilterConfig

Q = [20.0, 20.0, 4.0, 4.0]
P0 = [100.0, 100.0, 250.0, 250.0]
SPEED_RADAR = "speed_radar:SpeedRadar"
SIZES = {"cv": 4, "ca": 6, "ctrv": 5, "ctra": 6, "singer": 6, "ct": 5}
MEASUREMENT = np.array([[500.0], [0.4], [7.0]])


def problems(**keys) -> list[str]:
    with pytest.raises(ValidationError) as caught:
        FilterConfig.model_validate(keys)
    return [f"{'.'.join(map(str, path))}: {text}" for path, text in explain(caught.value, {})]


@pytest.mark.parametrize("motion", SIZES)
def test_stated_noise_is_the_same_for_every_step_and_moves_as_the_model_does(motion):
    variances = tuple(float(i) for i in range(1, SIZES[motion] + 1))
    plain = MOTION_MODELS[motion](**NOISE[motion])
    stated = ConstantProcessNoise(motion=plain, variances=variances)
    x = np.linspace(1.0, 2.0, SIZES[motion])
    for dt in (0.1, 1.0, 7.0):
        np.testing.assert_allclose(process_noise_covariance(stated, x, dt), np.diag(variances), rtol=1e-14)
        np.testing.assert_array_equal(stated.transition(x, dt), plain.transition(x, dt))
        np.testing.assert_array_equal(stated.jacobian(x, dt), plain.jacobian(x, dt))
    np.testing.assert_array_equal(process_noise_covariance(stated, x, 0.0), np.zeros((SIZES[motion],) * 2))
    assert (stated.components, stated.angular, stated.linear) == (plain.components, plain.angular, plain.linear)


@pytest.mark.parametrize(
    "keys",
    [
        {"filter": "kf"},
        {"filter": "ekf"},
        {"filter": "iekf"},
        {"filter": "ckf"},
        {"filter": "ukf"},
        {"filter": "ukf", "augmented": False},
    ],
    ids=str,
)
def test_every_filter_adds_the_stated_noise(keys):
    made = tracker(**keys, motion="cv", process_noise_diag=Q, initial={"velocity": "zero", "covariance_diag": P0})
    state, first = made.step(None, scan("radar", 0.0, MEASUREMENT))
    np.testing.assert_array_equal(first.covariance[..., 0], np.diag(P0))
    _, second = made.step(state, scan("radar", 2.0, MEASUREMENT, valid=False))
    f = np.eye(4) + 2.0 * np.eye(4, k=2)
    np.testing.assert_allclose(second.covariance[..., 0], f @ np.diag(P0) @ f.T + np.diag(Q), rtol=1e-12)


def test_a_second_sensor_at_the_same_instant_adds_no_noise():
    made = tracker(filter="ekf", motion="cv", process_noise_diag=Q, initial="first_measurement")
    state, first = made.step(None, scan("radar", 0.0, MEASUREMENT))
    _, second = made.step(state, scan("lidar", 0.0, MEASUREMENT[:2], valid=False))
    # What is computed is rounded up, also where no time passes.
    np.testing.assert_allclose(first.covariance, second.covariance, rtol=4 * linalg.MARGIN)


def test_published_filter_step_by_step():
    """Against the textbook, with its own arithmetic."""
    r = np.diag(np.square([30.0, 0.009, 1.0]))
    measurements = [np.array([[4243.0 + 15 * k], [0.785 - 0.003 * k], [21.0 + k]]) for k in range(4)]
    made = tracker(
        filter="ekf",
        motion="cv",
        process_noise_diag=Q,
        initial={"from": "first_measurement", "velocity": "radial", "covariance_diag": P0},
    )
    state = x = p = None
    f = np.eye(4) + np.eye(4, k=2)
    SENSOR_MODELS.get(SPEED_RADAR, SCENARIOS / "published")
    for k, z in enumerate(measurements):
        state, estimate = made.step(state, scan(SPEED_RADAR, float(k), z, noise=r))
        z = z[:, 0]
        if x is None:
            start = SENSOR_MODELS["radar"].position(scan("radar", 0.0, z, noise=r)).mean
            x, p = np.array([*start, z[2] * np.cos(z[1]), z[2] * np.sin(z[1])]), np.diag(P0)
        else:
            x, p = f @ x, f @ p @ f.T + np.diag(Q)
            px, py, vx, vy = x
            d, v = np.hypot(px, py), np.hypot(vx, vy)
            h = np.array([[px / d, py / d, 0, 0], [-py / d**2, px / d**2, 0, 0], [0, 0, vx / v, vy / v]])
            gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
            x, p = x + gain @ (z - [d, np.arctan2(py, px), v]), (np.eye(4) - gain @ h) @ p
        np.testing.assert_allclose(estimate.mean[:, 0], x, rtol=1e-10)
        np.testing.assert_allclose(estimate.covariance[..., 0], p, rtol=1e-8, atol=1e-8)


def test_a_stated_covariance_of_two_readings_keeps_their_mean():
    keys = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 2}
    stated = tracker(**keys, initial={"from": "two_measurements", "covariance_diag": P0})
    plain = tracker(**keys, initial="two_measurements")
    a = b = None
    for k in range(2):
        seen = scan("radar", float(k), MEASUREMENT + np.array([[10.0 * k], [0], [0]]))
        a, one = stated.step(a, seen)
        b, two = plain.step(b, seen)
    np.testing.assert_array_equal(one.mean, two.mean)
    np.testing.assert_array_equal(one.covariance[..., 0], np.diag(P0))


def test_from_truth_the_stated_covariance_is_claimed_and_the_sigmas_are_drawn():
    initial = {"from": "truth", "position_sigma_m": 3, "covariance_diag": P0}
    made = tracker(filter="ekf", motion="cv", process_noise_diag=Q, initial=initial)
    zero = np.zeros(1)
    made = made.with_prior(zero, Kinematics(*[zero] * 6), np.ones((6, 1)))
    assert made.prior.belief.mean[0, 0] == 3
    np.testing.assert_array_equal(made.prior.belief.covariance[..., 0], np.diag(P0))


def test_radial_velocity_starts_a_track():
    made = tracker(
        filter="ekf",
        motion="cv",
        process_noise_diag=Q,
        initial={"from": "first_measurement", "velocity": "radial", "velocity_sigma_mps": 3},
    )
    _, estimate = made.step(None, scan("radar", 0.0, MEASUREMENT, noise=RADAR_NOISE))
    np.testing.assert_allclose(estimate.mean[2:, 0], [7 * np.cos(0.4), 7 * np.sin(0.4)])
    np.testing.assert_allclose(estimate.covariance[2:, 2:, 0], 9 * np.eye(2))


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (
            {"motion": "cv", "process_noise_diag": [1.0, 1.0]},
            "process_noise_diag: motion cv needs 4 variances (px, py, vx, vy), not 2",
        ),
        (
            {"motion": "ctrv", "process_noise_diag": [1.0] * 5, "initial": {"covariance_diag": [1.0] * 4}},
            "initial.covariance_diag: motion ctrv needs 5 variances (px, py, v, yaw, yaw_rate), not 4",
        ),
        (
            {"motion": "cv", "process_noise_diag": Q, "acceleration_sigma_mps2": 1.0},
            "acceleration_sigma_mps2: not used with process_noise_diag, which replaces it; remove one of them",
        ),
        (
            {
                "motion": "cv",
                "process_noise_diag": Q,
                "initial": {"from": "first_measurement", "velocity_sigma_mps": 2.0, "covariance_diag": P0},
            },
            "initial.velocity_sigma_mps: not used with covariance_diag, which replaces it; remove one of them",
        ),
        (
            {"motion": "cv", "process_noise_diag": Q, "initial": {"from": "truth", "velocity": "radial"}},
            "initial.velocity: not used with from: truth; remove it, or use from: first_measurement",
        ),
        (
            {"motion": "cv_continuous", "process_noise_diag": Q, "acceleration_density_mps1p5": 1.0},
            "acceleration_density_mps1p5: not used with process_noise_diag, which replaces it; remove one of them",
        ),
        (
            {"motion": "cv", "process_noise_diag": Q, "sweep": {"motion": ["cv"]}},
            "sweep: only an entry of a scenario's trackers has this key",
        ),
    ],
)
def test_refused(keys, expected):
    assert problems(filter="ekf", **keys) == [expected]
