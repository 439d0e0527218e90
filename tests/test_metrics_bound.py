"""The Cramer-Rao bound where it is known in closed form."""

import numpy as np
import pytest
from tests.scenes import LIDAR_NOISE, RADAR_NOISE, fixed_observer, scan, truth

from trackbench.filters import Belief, ExtendedKalmanFilter, KalmanFilter
from trackbench.metrics.bound import BoundStart, cramer_rao, typical_acceleration
from trackbench.models.motion import ConstantVelocity
from trackbench.models.sensors import SENSOR_MODELS, Lidar, Mount, Radar
from trackbench.sensing.scans import ideal_sensors

LIDAR = Lidar(rate_hz=10, position_sigma_m=0.15)
RADAR = Radar(
    rate_hz=10,
    phase_s=0.05,
    range_sigma_m=0.3,
    azimuth_sigma_deg=float(np.rad2deg(0.02)),
    range_rate_sigma_mps=0.2,
    mount=Mount(x_m=2, yaw_deg=20),
)
PRIOR = BoundStart(velocity_sigma=3.0, position_sigma=1.0)


def moving(steps=41, dt=0.05, alive=None):
    """Two objects that move evenly past a fixed observer."""
    time = np.arange(steps) * dt
    px = np.stack([20 + 10 * time, 5 - 3 * time], axis=1)[..., None]
    py = np.stack([4 - 2 * time, 15 + 8 * time], axis=1)[..., None]
    vx = np.broadcast_to(np.array([10.0, -3.0])[:, None], px.shape)
    vy = np.broadcast_to(np.array([-2.0, 8.0])[:, None], px.shape)
    return truth(time, px, py, vx, vy, observer=fixed_observer(steps, 1.0, 2.0, 0.3), alive=alive)


def bound(of, sensors, prior=PRIOR, sigma=2.0, rate=1.0):
    ideal = ideal_sensors(of, sensors)
    rates = {s.name: rate * s.visible[..., 0].astype(float) for s in ideal}
    instants = np.unique(np.concatenate([s.steps for s in ideal]))
    return cramer_rao(of, ideal, rates, sigma, prior, instants), ideal, instants


def test_on_a_linear_problem_it_is_the_covariance_of_the_kalman_filter():
    of = moving()
    found, _, instants = bound(of, {"lidar": LIDAR})
    kalman = KalmanFilter(ConstantVelocity(acceleration_sigma_mps2=2.0))
    belief = Belief(np.zeros(4), np.diag([1.0, 1.0, 9.0, 9.0]))
    for row, step in enumerate(instants):
        if row > 0:
            belief = kalman.predict(belief, of.time[step] - of.time[instants[row - 1]])
        belief = kalman.update(belief, scan("lidar", of.time[step], np.zeros(2))).belief
        for i in range(2):
            np.testing.assert_allclose(found[row, i], np.diag(belief.covariance), rtol=1e-9)


def test_of_nonlinear_measurements_it_is_the_covariance_of_an_extended_filter_that_knows_the_truth():
    of = moving()
    found, ideal, instants = bound(of, {"radar": RADAR, "lidar": LIDAR})
    extended = ExtendedKalmanFilter(ConstantVelocity(acceleration_sigma_mps2=2.0))
    state = np.stack([of.px, of.py, of.vx, of.vy])[..., 0]
    for i in range(2):
        covariance, before = np.diag([1.0, 1.0, 9.0, 9.0]), 0
        for row, step in enumerate(instants):
            belief = extended.predict(Belief(state[:, before, i], covariance), of.time[step] - of.time[before])
            belief, before = belief._replace(mean=state[:, step, i]), step
            for sensor in ideal:
                for k in np.flatnonzero(sensor.steps == step):
                    pose, own = sensor.pose[:, k], sensor.velocity[:, k]
                    exact = SENSOR_MODELS[sensor.name].measure(belief.mean, pose, own)
                    seen = scan(sensor.name, 0.0, exact, pose=tuple(pose), velocity=tuple(own))
                    np.testing.assert_allclose(
                        sensor.noise_covariance, RADAR_NOISE if sensor.name == "radar" else LIDAR_NOISE
                    )
                    belief = extended.update(belief, seen).belief
            covariance = belief.covariance
            np.testing.assert_allclose(found[row, i], np.diag(covariance), rtol=1e-8)


def test_before_the_first_reading_there_is_no_bound_and_then_that_of_the_measurement():
    alive = np.ones((41, 2), dtype=bool)
    alive[:10, 1] = False
    found, _, instants = bound(moving(alive=alive), {"lidar": LIDAR}, BoundStart(velocity_sigma=20.0))
    late = np.searchsorted(instants, 10)
    assert np.isnan(found[:late, 1]).all()
    np.testing.assert_allclose(found[late, 1], [0.15**2] * 2 + [400] * 2, rtol=1e-6)
    assert np.isfinite(found[:, 0]).all()


def test_rarer_measurements_loosen_it_and_more_sensors_tighten_it():
    of = moving()
    full, half = bound(of, {"lidar": LIDAR})[0], bound(of, {"lidar": LIDAR}, rate=0.5)[0]
    assert np.all(half[:, :, :2] > full[:, :, :2])
    assert np.all(half[1:, :, 2:] > full[1:, :, 2:])
    both, _, instants = bound(of, {"lidar": LIDAR, "radar": RADAR})
    at_lidar = np.isin(instants, np.arange(0, 41, 2))
    assert np.all(both[at_lidar][1:] < full[1:])


def test_the_typical_acceleration_counts_both_directions_and_only_the_living():
    time = np.arange(3) * 0.1
    shape = (3, 2, 1)
    alive = np.array([[True, False]] * 3)
    of = truth(
        time,
        np.zeros(shape),
        np.zeros(shape),
        np.full(shape, 10.0),
        np.zeros(shape),
        acceleration=np.array([3.0, 100.0])[:, None],
        yaw_rate=0.4,
        alive=alive,
    )
    assert typical_acceleration(of) == pytest.approx(np.sqrt((3**2 + 4**2) / 2))
