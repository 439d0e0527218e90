"""The audit of logs with noise in the reference."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.recorded_log import WALKERS, Errors, write_log

from trackbench.subjects.log_audit.api import audit
from trackbench.subjects.log_audit.noise import residual_noises
from trackbench.truth.recorded.drive import Motion
from trackbench.truth.recorded.robust import body_sigmas, clipped, white_sigma

SMALL = Errors(
    time_offset_s=0.03,
    mount={"yaw_deg": 1.0},
    truly={"range_sigma_m": 0.45, "azimuth_sigma_deg": 0.75, "range_rate_sigma_mps": 0.15},
)


@pytest.mark.parametrize(
    ("truth_hz", "truth_from", "sigma"), [(20, 0, 0.05), (20, 2, 0.1), (10, 0, 0.1)], ids=["rows", "between", "both"]
)
def test_a_noisy_reference_is_no_error_of_the_sensors(
    tmp_path: Path, truth_hz: int, truth_from: int, sigma: float
) -> None:
    noisy = {"truth_hz": truth_hz, "truth_from": truth_from, "truth_sigma_m": sigma}
    item = audit(write_log(tmp_path, objects=WALKERS, moving=False, lidar=Errors(), **noisy))
    assert item.findings == ()
    for sensor in item.sensors.values():
        low, high = sensor.fit.estimates["time_offset"].interval.bounds(0.999)
        assert low < 0 < high
        # Least squares lie half way to the next row of the reference, 25 or 50 ms away.
        assert abs(sensor.fit.errors["time_offset"]) < 0.01
        assert sensor.square_before == pytest.approx(1, abs=0.08)


def test_small_errors_are_found_beside_a_noisy_reference(tmp_path: Path) -> None:
    item = audit(write_log(tmp_path, objects=WALKERS, moving=False, radar=SMALL, truth_sigma_m=0.1))
    assert {finding.kind for finding in item.findings} == {"time_offset", "mount_yaw", "sigma"}
    assert {finding.component for finding in item.findings} == {None, "range", "azimuth", "range_rate"}
    estimates = item.sensors["radar"].fit.estimates
    for name, value in (("time_offset", 0.03), ("mount_yaw", math.radians(1))):
        low, high = estimates[name].interval.bounds(0.999)
        assert low < value < high


def test_sigma_without_the_noise_of_the_reference() -> None:
    random = np.random.default_rng(3)
    added = random.uniform(0, 4, 20000)
    values = 1 + random.normal(size=20000) * np.sqrt(0.25 + added)
    values[:200] = 50
    middle, sigma = clipped(values, added)
    assert middle == pytest.approx(1, abs=0.03)
    assert sigma == pytest.approx(0.5, rel=0.06)


def test_the_noise_of_rows_is_estimated_beside_their_motion() -> None:
    random, time = np.random.default_rng(2), np.arange(0, 200, 0.1)
    motion = np.stack([20 * np.cos(0.4 * time), 20 * np.sin(0.4 * time)])
    vx, vy = -8 * np.sin(0.4 * time), 8 * np.cos(0.4 * time)
    assert white_sigma(motion) < 1e-3
    px, py = motion + random.normal(0, 0.05, motion.shape)
    assert body_sigmas(Motion(time, px, py, vx, vy))[0] == pytest.approx(0.05, rel=0.06)
    # Of positions once a second, what the velocity says is taken out first.
    slow = Motion(time[::10], px[::10], py[::10], vx[::10], vy[::10])
    assert body_sigmas(slow)[0] == pytest.approx(0.05, rel=0.25)
    # A velocity that was made of the positions has sqrt(1/2) of their noise in an interval.
    made = Motion(time, px, py, np.gradient(px, time), np.gradient(py, time))
    assert body_sigmas(made) == (pytest.approx(0.05, rel=0.06), pytest.approx(0.05 / (np.sqrt(2) * 0.1), rel=0.06))


def test_the_shape_of_a_noise_is_as_uncertain_as_the_noise_of_each_object_of_the_reference(tmp_path: Path) -> None:
    """Its share is the same at all ranges, so an error common to all objects would make no shape."""
    item = audit(write_log(tmp_path, objects=WALKERS, moving=False, radar=None, lidar=Errors(), truth_sigma_m=0.1))
    log, fit = item.sensors["lidar"].log, item.sensors["lidar"].fit
    exponent = item.sensors["lidar"].noise[0].exponent
    sure = residual_noises(replace(log, noise=replace(log.noise, uncertainty=0.0)), fit)[0][0].exponent
    # Mean logarithm of the range of each object, about that of all.
    along = np.log(log.polar(log.log.time, log.log.object, fit.errors)[0, fit.inlier])
    along -= along.mean()
    owner = log.log.object[fit.inlier]
    share = (fit.reference[0] / fit.scale[0] ** 2)[fit.inlier].mean()
    by_object = 0.5 * log.noise.uncertainty * share * np.bincount(owner, along) / (along @ along)
    added = math.sqrt(exponent.sigma**2 - sure.sigma**2)
    assert added == pytest.approx(float(np.linalg.norm(by_object)), rel=0.1)


def test_a_row_without_noise_beside_rows_of_a_noisy_reference() -> None:
    """Its weight is so much larger that the squares of the others' vanish."""
    residual, added = np.array([[0.5, 1.0, -1.0, 2.0]]), np.array([[0.0, 1.0, 1.0, 1.0]])
    middle, sigma = clipped(residual * 1e-3 + 1.0, added)
    assert np.isfinite(middle).all()
    assert np.isfinite(sigma).all()
