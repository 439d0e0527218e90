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
    """Of 40 objects at 25 scans, whose times and sensors are drawn twice, and others for each tracker."""
    for more in (0, 1000):
        estimates = through(
            tracker(**keys, initial=initial), measurements(20, 25, seed=[*TRACKERS.values()].index(keys) + more)
        )
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


# The Kalman filter on a radar is left out: the unbiased conversion moves a noiseless measurement.
NOISELESS = [(name, kind) for name in TRACKERS for kind in ("radar", "lidar") if name.startswith("ekf")]
NOISELESS += [("kf-cv", "lidar"), ("kf-ca", "lidar")]


@pytest.mark.parametrize(("name", "kind"), NOISELESS)
def test_noiseless_measurements_of_the_models_own_motion_give_no_error(name, kind):
    keys = TRACKERS[name]
    made = tracker(**keys, initial=TRUTH_START)
    start = Kinematics(*(np.full(1, value) for value in (30.0, 5.0, 12.0, 3.0, 0.4, 0.3)))
    made = made.with_prior(np.zeros(1), start, np.zeros((6, 1)))
    x, state = made.filter.motion.from_kinematics(start), None
    for k in range(60):
        x = x if k == 0 else made.filter.motion.transition(x, 0.1)
        target = made.filter.motion.to_cartesian(x)
        exact = SENSOR_MODELS[kind].measure(target, np.array(POSE), np.array(OWN))
        state, estimate = made.step(state, scan(kind, 0.1 * k, exact, pose=POSE, velocity=OWN))
        np.testing.assert_allclose(estimate.mean, target, atol=1e-9)
        np.testing.assert_allclose(estimate.innovation, 0, atol=1e-9)


@pytest.mark.parametrize("name", [name for name in TRACKERS if name.startswith(("ukf", "ckf"))])
def test_sigma_points_on_nearly_noiseless_measurements_err_in_second_order_only(name):
    keys = {key: 1e-3 if "sigma_" in key and "points" not in key else value for key, value in TRACKERS[name].items()}
    small = {"position_sigma_m": 1e-3, "velocity_sigma_mps": 1e-3}
    if keys["motion"] in ("ca", "ctra"):
        small["acceleration_sigma_mps2"] = 1e-3
    if keys["motion"] in ("ctrv", "ctra"):
        small["covariance_diag"] = [1e-6] * (5 if keys["motion"] == "ctrv" else 6)
    made = tracker(**keys, initial={"from": "truth", **small})
    start = Kinematics(*(np.full(1, value) for value in (30.0, 5.0, 12.0, 3.0, 0.4, 0.3)))
    made = made.with_prior(np.zeros(1), start, np.zeros((6, 1)))
    x, state = made.filter.motion.from_kinematics(start), None
    for k in range(40):
        x = x if k == 0 else made.filter.motion.transition(x, 0.1)
        target = made.filter.motion.to_cartesian(x)
        exact = SENSOR_MODELS["radar"].measure(target, np.array(POSE), np.array(OWN))
        noise = np.eye(3) * 1e-6
        state, estimate = made.step(state, scan("radar", 0.1 * k, exact, noise=noise, pose=POSE, velocity=OWN))
        np.testing.assert_allclose(estimate.mean, target, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ekf-cv", "ekf-ctra", "ukf-ctrv", "ckf-ctra"])
def test_thousands_of_steps_leave_the_filter_as_sound_as_ever(name):
    made = tracker(**TRACKERS[name], initial="first_measurement")
    random = np.random.default_rng(1)
    state, dt = None, 0.1
    target = np.stack([50 * np.ones(4), np.zeros(4), np.zeros(4), 10 * np.ones(4)])
    for k in range(4_000):
        angle = 0.2 * dt * k
        c, s = np.cos(angle), np.sin(angle)
        target = np.array([[50 * c], [50 * s], [-10 * s], [10 * c]])
        kind, noise = ("radar", RADAR_NOISE) if k % 2 else ("lidar", LIDAR_NOISE)
        exact = SENSOR_MODELS[kind].measure(target, np.zeros(3), np.zeros(2))
        sigma = np.sqrt(np.diag(noise))[:, None]
        state, estimate = made.step(state, scan(kind, k * dt, exact + sigma * random.normal(size=(len(noise), 4))))
    covariance = estimate.state_covariance
    np.testing.assert_allclose(covariance, np.swapaxes(covariance, 0, 1), rtol=1e-12, atol=1e-14)
    assert np.all(smallest_eigenvalue(covariance) > 0)
    assert np.all(np.hypot(*(estimate.mean - target)[:2]) < 1.5)
    assert estimate.repaired is None
