"""How tracks start, keep time and end up as estimates."""

import numpy as np
import pytest
from tests.support.scenes import LIDAR_NOISE, NOISE, RADAR_NOISE, scan, tracker

from trackbench.models.motion import Kinematics
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.raw import RawTracker

EKF = {"filter": "ekf", "motion": "cv", **NOISE["cv"]}
#: From the first two measurements that there are.
TWO = {"from": "two_measurements", "least_time_s": 0}
FAR = np.array([[40.0], [30.0]])


@pytest.mark.parametrize("kind", ["radar", "lidar"])
def test_from_the_first_reading(kind):
    measurement = np.array([[50.0], [0.6], [3.0]]) if kind == "radar" else FAR
    seen = scan(kind, 2.0, measurement)
    _, estimate = tracker(**EKF, initial={"velocity": "zero", "velocity_sigma_mps": 7.0}).step(None, seen)
    position = SENSOR_MODELS[kind].position(seen)
    np.testing.assert_allclose(estimate.mean[:, 0], [*position.mean[:, 0], 0, 0], atol=1e-12)
    stated = position.covariance[..., 0] if position.covariance.ndim == 3 else position.covariance
    np.testing.assert_allclose(estimate.covariance[:2, :2, 0], stated, atol=1e-12)
    np.testing.assert_allclose(estimate.covariance[2:, 2:, 0], 49 * np.eye(2))
    assert estimate.innovation is None or np.isnan(estimate.innovation).all()


def test_from_two_readings():
    made = tracker(**EKF, initial=TWO)
    state, first = made.step(None, scan("lidar", 0.0, FAR))
    assert np.isnan(first.mean).all()
    assert np.isnan(first.covariance).all()
    _, second = made.step(state, scan("lidar", 0.5, FAR + np.array([[5.0], [-2.0]])))
    np.testing.assert_allclose(second.mean[:, 0], [45, 28, 10, -4])
    variance = LIDAR_NOISE[0, 0]
    expected = variance * np.kron([[1, 2], [2, 8]], np.eye(2))
    np.testing.assert_allclose(second.covariance[..., 0], expected)


def test_from_two_readings_of_two_sensors():
    made = tracker(**EKF, initial=TWO)
    radar = scan("radar", 0.0, np.array([[50.0], [0.6], [3.0]]))
    first = SENSOR_MODELS["radar"].position(radar)
    state, _ = made.step(None, radar)
    _, estimate = made.step(state, scan("lidar", 0.5, FAR))
    np.testing.assert_allclose(estimate.mean[2:], (FAR - first.mean) / 0.5)
    np.testing.assert_allclose(estimate.covariance[2:, 2:, 0], (first.covariance[..., 0] + LIDAR_NOISE) / 0.25)


def test_two_readings_of_one_instant_do_not_start_a_track():
    made = tracker(**EKF, initial=TWO)
    state, _ = made.step(None, scan("lidar", 0.0, FAR))
    state, estimate = made.step(state, scan("lidar", 0.0, FAR + 1))
    assert np.isnan(estimate.mean).all()
    _, estimate = made.step(state, scan("lidar", 1.0, FAR + 1))
    # The first of the two measurements is the one that is kept.
    np.testing.assert_allclose(estimate.mean[2:, 0], [1, 1])


def test_each_lane_waits_for_its_own_measurements():
    made = tracker(**EKF, initial=TWO)
    measurements = [[True, False, False], [True, True, False], [False, True, False]]
    state, known = None, []
    for k, valid in enumerate(measurements):
        state, estimate = made.step(state, scan("lidar", 0.1 * k, np.repeat(FAR, 3, axis=1), valid=valid))
        known.append(np.isfinite(estimate.mean).all(axis=0))
    np.testing.assert_array_equal(known, [[False, False, False], [True, False, False], [True, True, False]])


def test_from_truth_draws_the_stated_error_and_takes_the_first_reading_in():
    batch = 40_000
    made = tracker(**EKF, initial={"from": "truth", "position_sigma_m": 2.0, "velocity_sigma_mps": 0.5})
    assert made.starts_from_truth
    motion = Kinematics(*(np.full(batch, value) for value in (40.0, 30.0, 10.0, np.pi / 2, 0.0, 0.0)))
    made = made.with_prior(np.full(batch, 1.0), motion, np.random.default_rng(0).normal(size=(6, batch)))
    error = made.prior.belief.mean - np.array([[40.0], [30.0], [0.0], [10.0]])
    np.testing.assert_allclose(np.cov(error), np.diag([4, 4, 0.25, 0.25]), atol=0.1)
    state, before = made.step(None, scan("lidar", 0.5, np.repeat(FAR, batch, axis=1), valid=False))
    assert np.isnan(before.mean).all()
    _, estimate = made.step(state, scan("lidar", 1.0, np.repeat(FAR, batch, axis=1)))
    np.testing.assert_allclose(estimate.innovation, FAR - made.prior.belief.mean[:2], atol=1e-12)
    gain = 4 / (4 + LIDAR_NOISE[0, 0])
    np.testing.assert_allclose(estimate.mean[:2], made.prior.belief.mean[:2] + gain * estimate.innovation, atol=1e-12)


def test_the_common_state_of_a_turning_model_is_cartesian():
    made = tracker(filter="ekf", motion="ctrv", initial=TWO, **NOISE["ctrv"])
    state, _ = made.step(None, scan("lidar", 0.0, FAR))
    _, estimate = made.step(state, scan("lidar", 1.0, FAR + np.array([[-8.0], [6.0]])))
    np.testing.assert_allclose(estimate.mean[:, 0], [32, 36, -8, 6], atol=1e-12)
    np.testing.assert_allclose(estimate.state[:, 0], [32, 36, 10, np.arctan2(6, -8), 0], atol=1e-12)
    assert estimate.state_covariance.shape == (5, 5, 1)


def test_a_repaired_covariance_is_reported_where_it_happened():
    made = tracker(filter="ukf", motion="cv", sigma_points="classic", augmented=False, initial=TWO, **NOISE["cv"])
    state = None
    for k in range(3):
        state, _ = made.step(state, scan("lidar", 0.1 * k, np.repeat(FAR, 2, axis=1)))
    broken = state.belief.covariance.copy()
    broken[0, 0, 1] = -1.0
    state = state._replace(belief=state.belief._replace(covariance=broken, factor=None))
    _, estimate = made.step(state, scan("lidar", 0.3, np.repeat(FAR, 2, axis=1)))
    np.testing.assert_array_equal(estimate.repaired, [False, True])
    assert np.isfinite(estimate.mean).all()
    assert np.linalg.eigvalsh(estimate.covariance[..., 1]).min() > 0


def test_the_raw_tracker_states_the_measurements():
    raw, state = RawTracker(), None
    state, estimate = raw.step(state, scan("lidar", 0.0, FAR))
    assert np.isnan(estimate.mean).all()
    state, estimate = raw.step(state, scan("lidar", 0.5, FAR + 1))
    np.testing.assert_allclose(estimate.mean[:, 0], [41, 31, 2, 2])
    np.testing.assert_allclose(estimate.covariance[..., 0], LIDAR_NOISE[0, 0] * np.kron([[1, 2], [2, 8]], np.eye(2)))
    # While measurements are missing, the last position stays.
    state, missed = raw.step(state, scan("lidar", 1.0, FAR, valid=False))
    np.testing.assert_array_equal(missed.mean, estimate.mean)
    # Of measurements at one instant the more precise counts, in whichever order they come.
    coarse = np.array([[60.0], [0.5], [0.0]])
    after, _ = raw.step(state, scan("radar", 1.5, coarse))
    _, both = raw.step(after, scan("lidar", 1.5, FAR))
    np.testing.assert_allclose(both.mean[:, 0], [40, 30, -1, -1])
    after, _ = raw.step(state, scan("lidar", 1.5, FAR))
    _, both = raw.step(after, scan("radar", 1.5, coarse))
    np.testing.assert_allclose(both.mean[:, 0], [40, 30, -1, -1])


def test_the_raw_tracker_converts_a_radar_measurement():
    raw = RawTracker()
    measurements = [scan("radar", 0.1 * k, np.array([[50.0 + k], [0.3], [4.0]]), noise=RADAR_NOISE) for k in range(2)]
    state, _ = raw.step(None, measurements[0])
    _, estimate = raw.step(state, measurements[1])
    first, second = (SENSOR_MODELS["radar"].position(seen) for seen in measurements)
    np.testing.assert_allclose(estimate.mean[:2], second.mean)
    np.testing.assert_allclose(estimate.mean[2:], (second.mean - first.mean) / 0.1)
    np.testing.assert_allclose(estimate.covariance[:2, :2], second.covariance)
