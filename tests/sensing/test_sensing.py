"""Measurements: geometry by hand, visibility, noise, and random streams that depend on nothing else."""

import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from scipy import stats
from tests.support.places import ROOT
from tests.support.scenes import fixed_observer, truth

from trackbench.base.types import Observer
from trackbench.models.sensors import Dropout, Lidar, Mount, Radar
from trackbench.runner.work import work_of
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.scans import ideal_sensors, sense_known
from trackbench.sensing.view import sensor_motion

RADAR = {"rate_hz": 10, "range_sigma_m": 0.3, "azimuth_sigma_deg": 1.0, "range_rate_sigma_mps": 0.2}
LIDAR = {"rate_hz": 10, "position_sigma_m": 0.15}


def resting(positions, steps=5, dt=0.1, **keys):
    """Objects that stand still at the given positions."""
    x, y = np.array(positions, dtype=float).T
    shape = (steps, len(x), 1)
    px, py = np.broadcast_to(x[:, None], shape), np.broadcast_to(y[:, None], shape)
    return truth(np.arange(steps) * dt, px, py, np.zeros(shape), np.zeros(shape), **keys)


def one(of, config):
    return ideal_sensors(of, {"sensor": config})[0]


def test_a_mounted_sensor_on_a_turned_observer_by_hand():
    # The observer at (10, 20) points north; the sensor is 2 m ahead of it, 1 m to its left, and looks left (west).
    of = resting([(4.0, 25.0)], observer=fixed_observer(5, 10.0, 20.0, np.pi / 2))
    mount = Mount(x_m=2, y_m=1, yaw_deg=90)
    ideal = one(of, Lidar(mount=mount, **LIDAR))
    np.testing.assert_allclose(ideal.pose[:, 0], [9, 22, np.pi], atol=1e-12)
    # From (9, 22) looking west, the target at (4, 25) is 5 m ahead and 3 m to the right.
    np.testing.assert_allclose(ideal.measurement[:, 0, 0, 0], [5, -3], atol=1e-12)
    seen = one(of, Radar(mount=mount, **RADAR))
    np.testing.assert_allclose(seen.measurement[:, 0, 0, 0], [np.hypot(5, 3), np.arctan2(-3, 5), 0], atol=1e-12)


def test_range_rate_includes_the_observers_velocity_and_the_rotation_of_its_lever_arm():
    steps = 3
    zero, unit = np.zeros(steps), np.ones(steps)
    # East at 20 m/s, turning left at 0.5 rad/s; the sensor 4 m ahead moves left at 0.5 * 4 = 2 m/s.
    observer = Observer(zero, zero, zero, 20 * unit, zero, 0.5 * unit)
    time = np.arange(steps) * 0.1
    px, py = np.array([54.0, 4.0]), np.array([0.0, 30.0])
    vx, vy = np.array([15.0, 0.0]), np.array([0.0, 3.0])
    of = truth(time, *(np.broadcast_to(v[:, None], (steps, 2, 1)) for v in (px, py, vx, vy)), observer=observer)
    ideal = one(of, Radar(mount=Mount(x_m=4), **RADAR))
    np.testing.assert_allclose(ideal.velocity[:, 0], [20, 2])
    # Closing on the car ahead at 5 m/s; the car to the left moves away at 3 m/s, of which the sensor follows 2.
    np.testing.assert_allclose(ideal.measurement[:, 0, 0, 0], [50, 0, -5], atol=1e-12)
    np.testing.assert_allclose(ideal.measurement[:, 0, 1, 0], [30, np.pi / 2, 1], atol=1e-12)


def test_the_velocity_of_a_sensor_is_the_derivative_of_its_position():
    time = np.arange(2001) * 1e-3
    yaw = 0.3 + 0.4 * time + 0.2 * time**2
    px, py = 5 * time, np.sin(time)
    observer = Observer(px, py, yaw, np.full_like(time, 5.0), np.cos(time), 0.4 + 0.4 * time)
    motion = sensor_motion(observer, Mount(x_m=3.6, y_m=-0.8, yaw_deg=30))
    numeric = np.gradient(motion.pose[:2], time, axis=1)
    np.testing.assert_allclose(motion.velocity[:, 1:-1], numeric[:, 1:-1], atol=1e-5)


def test_a_scan_carries_the_pose_the_noise_and_the_latency():
    of = resting([(10.0, 0.0)], observer=fixed_observer(5, 1.0, 2.0, 0.5))
    config = Radar(latency_s=0.25, mount=Mount(yaw_deg=10), **RADAR)
    scans = sense_known(ideal_sensors(of, {"front": config}), 1, "test", range(2)).scans
    assert [seen.time for seen in scans] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    for seen in scans:
        assert (seen.sensor, seen.kind) == ("front", "radar")
        assert seen.arrival_time == pytest.approx(seen.time + 0.25)
        np.testing.assert_allclose(seen.noise_covariance, np.diag([0.09, np.deg2rad(1) ** 2, 0.04]))
        np.testing.assert_allclose(seen.sensor_pose, [1, 2, 0.5 + np.deg2rad(10)])
        np.testing.assert_array_equal(seen.sensor_velocity, [0, 0])
        assert seen.measurement.shape == (3, 2)
        assert seen.valid.shape == (2,)


def test_noise_is_what_the_keys_say():
    of = resting([(30.0, 40.0)], steps=20)
    sensors = {"radar": Radar(**RADAR), "lidar": Lidar(**LIDAR)}
    measurements = sense_known(ideal_sensors(of, sensors), 3, "test", range(500))
    for kind, expected, sigma in [
        ("radar", [50.0, np.arctan2(40, 30), 0.0], [0.3, np.deg2rad(1), 0.2]),
        ("lidar", [30.0, 40.0], [0.15, 0.15]),
    ]:
        samples = np.concatenate([seen.measurement for seen in measurements.scans if seen.kind == kind], axis=1)
        count = samples.shape[1]
        assert count == 10_000
        standard_error = np.array(sigma) / np.sqrt(count)
        assert np.all(np.abs(samples.mean(axis=1) - expected) < 4 * standard_error)
        np.testing.assert_allclose(samples.std(axis=1), sigma, rtol=0.03)
        assert np.abs(np.corrcoef(samples) - np.eye(len(sigma))).max() < 0.05
        assert stats.kstest((samples[0] - expected[0]) / sigma[0], "norm").pvalue > 1e-3


def test_an_azimuth_stays_in_its_range_behind_the_sensor():
    measurements = sense_known(ideal_sensors(resting([(-20.0, 0.0)]), {"radar": Radar(**RADAR)}), 1, "test", range(200))
    azimuths = np.concatenate([seen.measurement[1] for seen in measurements.scans])
    assert np.all((azimuths > -np.pi) & (azimuths <= np.pi))
    assert azimuths.min() < 0 < azimuths.max()


def at(bearing_deg, far=20.0):
    return far * np.cos(np.deg2rad(bearing_deg)), far * np.sin(np.deg2rad(bearing_deg))


def test_the_field_of_view_has_its_edges_half_to_each_side_of_the_boresight():
    of = resting([at(bearing) for bearing in (30, 69.9, 70.1, 80, -9.9, -10.1, 210)])
    ideal = one(of, Lidar(fov_deg=80, mount=Mount(yaw_deg=30), **LIDAR))
    np.testing.assert_array_equal(ideal.visible[0, :, 0], [True, True, False, False, True, False, False])


def test_a_full_circle_sees_everything():
    of = resting([at(bearing) for bearing in (0, 90, 180, -180, 179.999999)])
    assert one(of, Radar(fov_deg=360, **RADAR)).visible.all()


def test_beyond_the_maximum_range_nothing_is_seen():
    of = resting([at(20, 99.9), at(20, 100.1), at(-150, 5.0)])
    ideal = one(of, Radar(max_range_m=100, mount=Mount(x_m=0), **RADAR))
    np.testing.assert_array_equal(ideal.visible[0, :, 0], [True, False, True])
    # It counts from the sensor, not from the observer.
    ideal = one(of, Radar(max_range_m=100, mount=Mount(x_m=5), **RADAR))
    np.testing.assert_array_equal(ideal.visible[0, :, 0], [True, True, True])


def test_what_is_not_valid_is_not_a_number():
    of = resting([at(0), at(90)])
    ideal = ideal_sensors(of, {"radar": Radar(fov_deg=90, detection_probability=0.5, **RADAR)})
    for seen in sense_known(ideal, 1, "test", range(50)).scans:
        np.testing.assert_array_equal(np.isnan(seen.measurement), np.repeat(~seen.valid[None], 3, axis=0))
        assert not seen.valid.reshape(2, 50)[1].any()
        assert seen.valid.reshape(2, 50)[0].any()


def test_objects_that_are_not_there_are_not_seen():
    alive = np.array([[True, False], [True, True], [False, True]])
    of = resting([at(0), at(10)], steps=3, alive=alive)
    measurements = sense_known(ideal_sensors(of, {"lidar": Lidar(**LIDAR)}), 1, "test", range(3))
    for k, seen in enumerate(measurements.scans):
        np.testing.assert_array_equal(seen.valid.reshape(2, 3), np.repeat(alive[k][:, None], 3, axis=1))


@pytest.mark.parametrize("probability", [0.05, 0.6, 0.95, 1.0])
def test_detections_come_with_their_probability(probability):
    of = resting([at(0), at(10)], steps=50)
    config = Lidar(detection_probability=probability, **LIDAR)
    measurements = sense_known(ideal_sensors(of, {"lidar": config}), 7, "test", range(100))
    count = sum(seen.valid.sum() for seen in measurements.scans)
    low, high = stats.binom.ppf([1e-4, 1 - 1e-4], 50 * 2 * 100, probability)
    assert low <= count <= high
    assert measurements.detected() == {"lidar": count}


def test_a_sensor_is_silent_from_the_first_instant_of_a_dropout_to_before_its_last():
    of = resting([at(0)], steps=10)
    gaps = [Dropout(from_s=0.2, to_s=0.4), Dropout(from_s=0.7, to_s=0.8)]
    measurements = sense_known(ideal_sensors(of, {"lidar": Lidar(dropouts=gaps, **LIDAR)}), 1, "test", range(1))
    valid = [bool(seen.valid[0]) for seen in measurements.scans]
    assert valid == [True, True, False, False, True, True, True, False, True, True]


def test_rate_and_phase_choose_the_instants():
    of = resting([at(0)], steps=21, dt=0.05)
    lidar = Lidar(rate_hz=5, position_sigma_m=0.1, phase_s=0.1)
    radar = Radar(**{**RADAR, "rate_hz": 20})
    measurements = sense_known(ideal_sensors(of, {"lidar": lidar, "radar": radar}), 1, "test", range(1))
    times = {kind: [seen.time for seen in measurements.scans if seen.kind == kind] for kind in ("lidar", "radar")}
    assert times["lidar"] == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9])
    assert times["radar"] == pytest.approx(np.arange(21) * 0.05)


def test_scans_come_by_time_and_then_in_the_order_of_the_scenario():
    of = resting([at(0)], steps=3)
    sensors = {"b": Lidar(**LIDAR), "a": Radar(**RADAR), "c": Lidar(**LIDAR)}
    scans = sense_known(ideal_sensors(of, sensors), 1, "test", range(1)).scans
    assert [seen.sensor for seen in scans] == ["b", "a", "c"] * 3
    assert [seen.time for seen in scans] == sorted(seen.time for seen in scans)


def noise_of_run_17(sensors, runs, scenario="test", seed=5):
    of = resting([at(0), at(40)], steps=6)
    scans = sense_known(ideal_sensors(of, sensors), seed, scenario, runs).scans
    column = runs.index(17)
    return np.stack([s.measurement.reshape(-1, 2, len(runs))[:, :, column] for s in scans if s.sensor == "lidar"])


def test_the_noise_of_a_run_depends_on_nothing_but_its_number_and_the_seed():
    lidar = Lidar(detection_probability=0.7, **LIDAR)
    expected = noise_of_run_17({"lidar": lidar}, range(20))
    assert np.isnan(expected).any()
    for sensors, runs in [
        ({"lidar": lidar}, range(17, 18)),
        ({"lidar": lidar}, range(16, 21)),
        ({"radar": Radar(**RADAR), "lidar": lidar}, range(12, 20)),
        ({"lidar": lidar, "another": lidar}, range(30)),
    ]:
        np.testing.assert_array_equal(noise_of_run_17(sensors, runs), expected)
    for other in [{"seed": 6}, {"scenario": "other"}]:
        assert not np.array_equal(noise_of_run_17({"lidar": lidar}, range(20), **other), expected, equal_nan=True)


def test_runs_and_sensors_differ_and_fingerprints_tell():
    of = resting([at(0)], steps=6)
    lidar = Lidar(**LIDAR)
    measurements = sense_known(ideal_sensors(of, {"a": lidar, "b": lidar}), 1, "test", range(3))
    a, b = (np.stack([seen.measurement for seen in measurements.scans if seen.sensor == name]) for name in "ab")
    assert not np.allclose(a, b)
    assert not np.allclose(a[..., 0], a[..., 1])
    assert len(set(measurements.digests)) == 3
    again = sense_known(ideal_sensors(of, {"a": lidar, "b": lidar}), 1, "test", range(1, 3))
    assert again.digests == measurements.digests[1:]


def test_a_truth_that_differs_from_run_to_run_is_read_run_by_run():
    px = np.broadcast_to(np.array([10.0, 20.0, 30.0]), (4, 1, 3))
    of = truth(np.arange(4) * 0.1, px, np.zeros((4, 1, 3)), np.zeros((4, 1, 3)), np.zeros((4, 1, 3)))
    ideal = ideal_sensors(of, {"lidar": Lidar(rate_hz=10, position_sigma_m=1e-6)})
    for seen in sense_known(ideal, 1, "test", range(1, 3)).scans:
        np.testing.assert_allclose(seen.measurement[0], [20, 30], atol=1e-6)


#: What NumPy takes for faster functions where the processor has it.
WIDE_VECTORS = "X86_V4 AVX512_ICL AVX512_SPR"


def digests_of_highway():
    """Of the measurements of 5 s of motorway traffic, in a dozen runs."""
    loaded = load_scenario("highway", ["truth.duration_s=5"])
    work = work_of(loaded, truths_of(loaded))
    return [digest.hex() for digest in sense_known(work.scenes[0].sensors, 1, "test", range(12)).digests]


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="NumPy has no such switch here")
def test_scans_are_the_same_bits_without_the_vectors_of_the_processor():
    code = "from tests.sensing.test_sensing import digests_of_highway; print(*digests_of_highway())"
    command, switched = [sys.executable, "-c", code], {"NPY_DISABLE_CPU_FEATURES": WIDE_VECTORS}
    environment = os.environ | switched | {"PYTHONPATH": str(ROOT)}
    printed = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split()
    assert printed
    assert printed == digests_of_highway()
