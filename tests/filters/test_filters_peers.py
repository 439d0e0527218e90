"""The same measurements through FilterPy and Stone Soup."""

import numpy as np
import pytest
from tests.support import peers, reference
from tests.support.scenes import LIDAR_NOISE, RADAR_NOISE, member, scan, tracker

from trackbench.models.motion import Kinematics
from trackbench.models.sensors import SENSOR_MODELS

DT, STEPS, BATCH_SIZE = 0.05, 200, 3
NOISE = {"acceleration_sigma_mps2": peers.ACCELERATION_SIGMA}
YAW_NOISE = {"yaw_acceleration_sigma_radps2": peers.YAW_ACCELERATION_SIGMA}
SPREAD = {"from": "truth", "position_sigma_m": 0.5, "velocity_sigma_mps": 1.0}


def course(time):
    return 2.4 + 0.6 * time + 0.3 * np.sin(time)


def measurements():
    """Alternating radar and lidar of a target that weaves around the sensor, its azimuth and course passing pi."""
    random = np.random.default_rng(4)
    x, y = 12.0, 6.0
    still, pose = np.zeros(2), np.zeros(3)
    for k in range(STEPS):
        vx, vy = 8 * np.cos(course(k * DT)), 8 * np.sin(course(k * DT))
        kind, noise = ("lidar", LIDAR_NOISE) if k % 2 else ("radar", RADAR_NOISE)
        exact = SENSOR_MODELS[kind].measure(np.array([x, y, vx, vy]), pose, still)
        error = random.multivariate_normal(np.zeros(len(noise)), noise, BATCH_SIZE).T
        yield scan(kind, k * DT, exact[:, None] + error)
        x, y = x + DT * vx, y + DT * vy


@pytest.mark.parametrize(
    ("peer", "keys"),
    [
        (peers.filterpy_ekf_cv, {"filter": "ekf", "motion": "cv", **NOISE}),
        (peers.stonesoup_ekf_cv, {"filter": "ekf", "motion": "cv", **NOISE}),
        (peers.filterpy_ukf_ctrv, {"filter": "ukf", "motion": "ctrv", "augmented": False, **NOISE, **YAW_NOISE}),
        (peers.stonesoup_ukf_ctrv, {"filter": "ukf", "motion": "ctrv", "augmented": False, **NOISE, **YAW_NOISE}),
    ],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_estimates_agree_to_four_digits(peer, keys):
    scans = list(measurements())
    yaw = {"yaw_rate_sigma_radps": 0.1} if keys["motion"] == "ctrv" else {}
    start = Kinematics(*(np.full(BATCH_SIZE, value) for value in (12.0, 6.0, 8.0, course(0.0), 0.0, 0.9)))
    normal = np.random.default_rng(9).normal(size=(6, BATCH_SIZE))
    ours = tracker(**keys, initial={**SPREAD, **yaw}).with_prior(np.zeros(BATCH_SIZE), start, normal)
    state, found = None, []
    for seen in scans:
        state, estimate = ours.step(state, seen)
        found.append(estimate.state)
    angular = ours.filter.motion.angular
    for i in range(BATCH_SIZE):
        theirs = peer(
            ours.prior.belief.mean[:, i], ours.prior.belief.covariance[..., i], [member(seen, i) for seen in scans], DT
        )
        for k in range(STEPS):
            miss = reference.residual(angular)(found[k][:, i], theirs[k])
            np.testing.assert_allclose(miss, 0, atol=1e-4)
