"""The plug-in beside the scenarios at 3 km, a radar that reads a speed; a tracker that takes a Doppler radar for it."""

import numpy as np
import pytest
from tests.support.places import SCENARIOS
from tests.support.scenes import NOISE, RADAR_NOISE, block_of, scan, tracker, truth, work

from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.config import FilterConfig

SENSOR = {"rate_hz": 1, "range_sigma_m": 30, "azimuth_sigma_deg": 0.5, "speed_sigma_mps": 2}
KIND = "speed_radar:SpeedRadar"
SPEED, DOPPLER = SENSOR_MODELS.get(KIND, SCENARIOS / "published"), SENSOR_MODELS["radar"]


def test_reads_the_speed_over_ground_whatever_the_sensor_does():
    target, pose = np.array([30.0, 40.0, 3.0, -4.0]), np.array([0.0, 0.0, np.pi / 2])
    for own in ([0.0, 0.0], [9.0, 9.0]):
        np.testing.assert_allclose(SPEED.measure(target, pose, np.array(own)), [50, np.arctan2(4, 3) - np.pi / 2, 5])


def test_position_is_that_of_a_radar():
    seen = scan("radar", 0.0, np.array([50.0, 0.3, 7.0]), pose=(1.0, 2.0, 0.5))
    for a, b in zip(SPEED.position(seen), DOPPLER.position(seen), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_target_at_rest_gives_a_finite_jacobian():
    at_rest = np.array([10.0, 5.0, 0.0, 0.0])
    np.testing.assert_array_equal(SPEED.jacobian(at_rest, np.zeros(3), np.zeros(2))[2], np.zeros(4))


def test_noise_in_si_units():
    np.testing.assert_allclose(SPEED(**SENSOR).sigmas(), [30, np.deg2rad(0.5), 2])


@pytest.mark.parametrize("name", ["kf", "ekf", "ukf", "ckf"])
def test_every_filter_follows_a_target_by_it(name):
    random = np.random.default_rng(1)
    scans = []
    for time in 0.05 * np.arange(120):
        ideal = SPEED.measure(np.array([20 + 12 * time, 15 + 3 * time, 12, 3]), np.zeros(3), np.zeros(2))
        measured = ideal + np.sqrt(np.diag(RADAR_NOISE)) * random.standard_normal(3)
        scans.append(scan(KIND, time, measured[:, None], noise=RADAR_NOISE))
    made, state = tracker(filter=name, motion="cv", **NOISE["cv"]), None
    for item in scans:
        state, estimate = made.step(state, item)
    last = 0.05 * 119
    np.testing.assert_allclose(estimate.mean[:, 0], [20 + 12 * last, 15 + 3 * last, 12, 3], atol=2.0)


def test_radial_velocity_of_each_kind():
    measurement = np.array([50.0, 0.0, 7.0])
    seen = scan("radar", 0.0, measurement, pose=(0.0, 0.0, np.pi / 2), velocity=(2.0, 1.0))
    np.testing.assert_allclose(DOPPLER.radial_velocity(seen), [2, 8], atol=1e-14)
    np.testing.assert_allclose(SPEED.radial_velocity(seen), [0, 7], atol=1e-14)
    lidar = scan("lidar", 0.0, np.array([50.0, 0.0]))
    np.testing.assert_array_equal(SENSOR_MODELS["lidar"].radial_velocity(lidar), [0, 0])


def test_taking_a_range_rate_for_the_speed_is_another_model_and_not_other_measurements():
    keys = {"filter": "ekf", "motion": "cv", **NOISE["cv"], "initial": "first_measurement"}
    confused, speed = tracker(**keys, sensor_models={"radar": KIND}), tracker(**keys)
    state, other = None, None
    for k in range(5):
        doppler = scan("radar", float(k), np.array([[50.0 + k], [0.2], [1.0]]))
        state, found = confused.step(state, doppler)
        other, expected = speed.step(other, doppler._replace(kind=KIND))
        np.testing.assert_array_equal(found.mean, expected.mean)


def test_the_confusion_leaves_other_sensors_alone():
    keys = {"filter": "ekf", "motion": "cv", **NOISE["cv"], "initial": "first_measurement"}
    confused, plain = tracker(**keys, sensor_models={"elsewhere": KIND}), tracker(**keys)
    seen = [scan("radar", float(k), np.array([[50.0 + k], [0.2], [1.0]])) for k in range(3)]
    a = b = None
    for item in seen:
        a, one = confused.step(a, item)
        b, two = plain.step(b, item)
    np.testing.assert_array_equal(one.mean, two.mean)


def test_synthetic_measurements_scatter_as_stated():
    time = np.arange(400.0)
    of = truth(time, *(np.full((400, 1, 1), value) for value in (3000.0, 0.0, 0.0, 12.0)))
    config = FilterConfig(filter="ekf", motion="cv", acceleration_sigma_mps2=1)
    block = block_of(work(of, {"radar": SPEED(**SENSOR)}, {"ekf": config}, 1), range(1))
    third = np.array([item.measurement[2, 0] for item in block.recorded_scans.scans])
    assert third.mean() == pytest.approx(12, abs=4 * 2 / 20)
    assert third.std() == pytest.approx(2, rel=0.15)
