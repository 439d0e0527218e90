"""Sensor models against finite differences, motion over a short time, and samples."""

import numpy as np
import pytest
from tests.models.test_motion_models import finite_difference
from tests.support.scenes import LIDAR_NOISE, RADAR_NOISE, scan

from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS

every_sensor = pytest.mark.parametrize("model", SENSOR_MODELS.loaded().values(), ids=SENSOR_MODELS.names())

SIZE = 400


def situations(seed: int = 0) -> tuple[np.ndarray, ...]:
    """Poses of sensors, their velocities, and targets 1 m to 200 m away: ``(3, 400)``, ``(2, 400)``, ``(4, 400)``."""
    random = np.random.default_rng(seed)
    pose = random.uniform([[-50], [-50], [-4]], [[50], [50], [4]], (3, SIZE))
    far, bearing = random.uniform(1, 200, SIZE), random.uniform(-np.pi, np.pi, SIZE)
    far[::10], bearing[::10] = 1.0, np.resize([0.0, np.pi, -np.pi, np.pi / 2], SIZE // 10)
    pose[2, ::20] = 0.0
    own, velocity = random.uniform(-30, 30, (2, 2, SIZE))
    return pose, own, np.concatenate([pose[:2] + far * np.array([np.cos(bearing), np.sin(bearing)]), velocity])


@every_sensor
def test_jacobian_agrees_with_finite_differences(model):
    pose, own, target = situations()
    # At rest the speed has a kink, and no derivative.
    moving = np.hypot(*target[2:]) > 0.5
    pose, own, target = pose[:, moving], own[:, moving], target[:, moving]
    # Taken as offsets from one measurement, so that an azimuth at half a turn does not jump.
    centre = model.measure(target, pose, own)
    expected = finite_difference(lambda x: difference(model.measure(x, pose, own), centre, model.angular), target)
    np.testing.assert_allclose(model.jacobian(target, pose, own), expected, atol=1e-6)


def test_range_rate_is_the_rate_of_the_range():
    radar, (pose, own, target) = SENSOR_MODELS["radar"], situations()

    def seen(t: float) -> np.ndarray:
        there, moved = target.copy(), pose.copy()
        there[:2] += t * target[2:]
        moved[:2] += t * own
        return radar.measure(there, moved, own)

    np.testing.assert_allclose(seen(0.0)[2], (seen(1e-5)[0] - seen(-1e-5)[0]) / 2e-5, rtol=0, atol=1e-5)


def test_measurements_by_hand():
    # A sensor at (10, 5) that looks north; a target 3 m ahead of it and 4 m to its left.
    pose, target = np.array([10.0, 5.0, np.pi / 2]), np.array([6.0, 8.0, 0.0, 2.0])
    np.testing.assert_allclose(SENSOR_MODELS["lidar"].measure(target, pose, np.zeros(2)), [3, 4], atol=1e-14)
    own = np.array([0.0, 7.0])
    expected = [5.0, np.arctan2(4, 3), 3 / 5 * (2 - 7)]
    np.testing.assert_allclose(SENSOR_MODELS["radar"].measure(target, pose, own), expected, atol=1e-14)


def test_a_target_on_the_radar_gives_finite_numbers():
    at, still = np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(2)
    radar, pose = SENSOR_MODELS["radar"], np.array([1.0, 2.0, 0.0])
    assert np.isfinite(radar.measure(at, pose, still)).all()
    assert np.isfinite(radar.jacobian(at, pose, still)).all()


@every_sensor
def test_position_inverts_measure(model):
    pose, _, target = situations()
    target[2:] = 0.0
    measurement = model.measure(target, pose, np.zeros(2))
    tiny = np.eye(len(measurement)) * 1e-12
    found = model.position(scan(model.kind, 0.0, measurement, noise=tiny, pose=tuple(pose)))
    np.testing.assert_allclose(found.mean, target[:2], atol=1e-7)


@pytest.mark.parametrize(
    ("kind", "noise"),
    [("lidar", LIDAR_NOISE), ("radar", RADAR_NOISE), ("radar", np.diag(np.square([1.0, 0.1, 0.2])))],
    ids=["lidar", "radar", "coarse radar"],
)
def test_converted_position_is_unbiased_and_its_covariance_honest(kind, noise):
    model, samples = SENSOR_MODELS[kind], 100_000
    pose, target = (3.0, -2.0, 0.7), np.array([43.0, 28.0, 1.0, 2.0])
    error = np.random.default_rng(2).multivariate_normal(np.zeros(len(noise)), noise, samples).T
    measurement = model.measure(target, np.array(pose), np.zeros(2))[:, None] + error
    mean, covariance = model.position(scan(kind, 0.0, measurement, noise=noise, pose=pose))
    miss = mean - target[:2, None]
    standard_error = miss.std(axis=1) / np.sqrt(samples)
    assert np.all(np.abs(miss.mean(axis=1)) < 4 * standard_error)
    stated = covariance if covariance.ndim == 2 else covariance.mean(axis=2)
    np.testing.assert_allclose(np.cov(miss), stated, rtol=0.03, atol=0.02 * np.trace(stated))
