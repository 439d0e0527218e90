"""The plug-in beside the scenarios at 3 km, a radar that reads a speed; a tracker that takes a Doppler radar for it."""

import numpy as np
from tests.support.places import SCENARIOS
from tests.support.scenes import NOISE, scan, tracker

from trackbench.models.sensors import SENSOR_MODELS

SENSOR = {"rate_hz": 1, "range_sigma_m": 30, "azimuth_sigma_deg": 0.5, "speed_sigma_mps": 2}
KIND = "speed_radar:SpeedRadar"
SPEED, DOPPLER = SENSOR_MODELS.get(KIND, SCENARIOS / "published"), SENSOR_MODELS["radar"]


def test_reads_the_speed_over_ground_whatever_the_sensor_does():
    target, pose = np.array([30.0, 40.0, 3.0, -4.0]), np.array([0.0, 0.0, np.pi / 2])
    for own in ([0.0, 0.0], [9.0, 9.0]):
        np.testing.assert_allclose(SPEED.measure(target, pose, np.array(own)), [50, np.arctan2(4, 3) - np.pi / 2, 5])


def test_a_target_at_rest_gives_a_finite_jacobian():
    at_rest = np.array([10.0, 5.0, 0.0, 0.0])
    np.testing.assert_array_equal(SPEED.jacobian(at_rest, np.zeros(3), np.zeros(2))[2], np.zeros(4))


def test_noise_in_si_units():
    np.testing.assert_allclose(SPEED(**SENSOR).sigmas(), [30, np.deg2rad(0.5), 2])


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
