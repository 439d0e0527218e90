"""What holds for every filter and motion model, whatever the measurements."""

import numpy as np
import pytest
from tests.support.scenes import LIDAR_NOISE, RADAR_NOISE, TRACKERS, member, scan, tracker

from trackbench.models.motion import Kinematics
from trackbench.models.sensors import SENSOR_MODELS

every_tracker = pytest.mark.parametrize("keys", TRACKERS.values(), ids=TRACKERS)
TRUTH_START = {"from": "truth", "position_sigma_m": 0.5, "velocity_sigma_mps": 1.0}
POSE, OWN = (1.0, -2.0, 0.3), (5.0, 1.0)


def measurements(batch: int, steps: int, seed: int, detection: float = 0.8):
    """Radar and lidar at irregular times, some of them together, of targets in ordinary traffic motion."""
    random = np.random.default_rng(seed)
    position = random.uniform([20, -10], [60, 30], (batch, 2)).T
    speed, course, turn = random.uniform(5, 25, batch), random.uniform(-4, 4, batch), random.uniform(-0.4, 0.4, batch)
    time = 0.0
    for _ in range(steps):
        dt = random.choice([0.0, 0.05, 0.1, 0.4])
        time, course = time + dt, course + turn * dt
        velocity = speed * np.array([np.cos(course), np.sin(course)])
        position = position + dt * velocity
        kind, noise = ("radar", RADAR_NOISE) if random.random() < 0.5 else ("lidar", LIDAR_NOISE)
        exact = SENSOR_MODELS[kind].measure(np.concatenate([position, velocity]), np.array(POSE), np.array(OWN))
        measurement = exact + random.multivariate_normal(np.zeros(len(noise)), noise, batch).T
        yield scan(kind, time, measurement, valid=random.random(batch) < detection, pose=POSE, velocity=OWN)


def through(made, scans):
    state, estimates = None, []
    for seen in scans:
        state, estimate = made.step(state, seen)
        estimates.append(estimate)
    return estimates


def smallest_eigenvalue(covariance):
    return np.linalg.eigvalsh(np.moveaxis(covariance, (0, 1), (-2, -1)))[..., 0]


def assert_member_is(batch, single, index, tolerance):
    for name in ("mean", "covariance", "innovation", "innovation_covariance"):
        whole, alone = getattr(batch, name), getattr(single, name)
        if alone is None or (name.startswith("innovation") and np.isnan(single.innovation).any()):
            continue
        np.testing.assert_allclose(whole[..., index], alone, rtol=tolerance, atol=tolerance, err_msg=name)


@every_tracker
@pytest.mark.parametrize("initial", ["first_measurement", "two_measurements", "truth"])
def test_a_batch_is_the_loop_over_its_members(keys, initial):
    size = 4
    scans = list(measurements(size, 14, seed=3))
    # One member is seen late, one not at all.
    late = np.array([True, True, False, False])
    scans[:6] = [
        seen._replace(valid=seen.valid & late, measurement=np.where(seen.valid & late, seen.measurement, np.nan))
        for seen in scans[:6]
    ]
    never = np.array([True, True, True, False])
    scans = [
        s._replace(valid=s.valid & never, measurement=np.where(s.valid & never, s.measurement, np.nan)) for s in scans
    ]
    start = TRUTH_START if initial == "truth" else {"from": initial}
    made = tracker(**keys, initial=start)
    alone = [made] * size
    if initial == "truth":
        motion = Kinematics(*(np.linspace(a, a + 1, size) for a in (30.0, 10.0, 12.0, 3.0, 0.5, 0.2)))
        times = np.array([scans[0].time, scans[2].time, scans[6].time, np.inf])
        normal = np.random.default_rng(0).normal(size=(6, size))
        alone = [
            made.with_prior(times[i], Kinematics(*(value[i] for value in motion)), normal[:, i]) for i in range(size)
        ]
        made = made.with_prior(times, motion, normal)
    batch = through(made, scans)
    for i in range(size):
        for whole, single in zip(batch, through(alone[i], [member(seen, i) for seen in scans]), strict=True):
            assert_member_is(whole, single, i, 1e-12)
    assert np.isfinite(batch[-1].mean[:, :3]).all()
    assert np.isnan(batch[-1].mean[:, 3]).all()


@every_tracker
@pytest.mark.parametrize("initial", ["first_measurement", "two_measurements"])
def test_covariances_stay_symmetric_and_positive_definite(keys, initial):
    """Of 20 objects at 25 scans, whose times and sensors are others for each tracker."""
    seed = [*TRACKERS.values()].index(keys)
    estimates = through(tracker(**keys, initial=initial), measurements(20, 25, seed=seed))
    started = np.stack([np.isfinite(estimate.mean[0]) for estimate in estimates], axis=-1)
    for part in ("covariance", "state_covariance"):
        covariance = np.stack([getattr(estimate, part) for estimate in estimates], axis=-1)
        np.testing.assert_allclose(covariance, np.swapaxes(covariance, 0, 1), rtol=1e-12, atol=1e-12)
        assert np.all(smallest_eigenvalue(covariance[..., started]) > 0)
    innovations = [each.innovation_covariance for each in estimates if each.innovation_covariance is not None]
    assert all(np.all(smallest_eigenvalue(innovation) > 0) for innovation in innovations)


@every_tracker
def test_a_missed_measurement_only_predicts(keys):
    scans = list(measurements(2, 6, seed=8, detection=1.0))
    made = tracker(**keys)
    state = None
    for seen in scans:
        state, _ = made.step(state, seen)
    missed = scan("lidar", scans[-1].time + 0.3, np.zeros((2, 2)), valid=[True, False])
    _, estimate = made.step(state, missed)
    predicted = made.filter.predict(state.belief, 0.3)
    np.testing.assert_allclose(estimate.state[:, 1], predicted.mean[:, 1], rtol=1e-13)
    np.testing.assert_allclose(estimate.state_covariance[..., 1], predicted.covariance[..., 1], rtol=1e-12, atol=1e-13)
    assert not np.allclose(estimate.state[:, 0], predicted.mean[:, 0])


@every_tracker
def test_no_time_means_no_prediction(keys):
    made = tracker(**keys)
    state = None
    for seen in measurements(3, 6, seed=2, detection=1.0):
        state, before = made.step(state, seen)
    nothing = scan("lidar", state.time, np.zeros((2, 3)), valid=False)
    _, after = made.step(state, nothing)
    np.testing.assert_allclose(after.mean, before.mean, atol=1e-12)
    np.testing.assert_allclose(after.covariance, before.covariance, rtol=1e-9, atol=1e-11)
