"""Which measurements start a track, and what is said before it starts."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from trackbench.base.types import Estimate, Scan
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig

#: A target at 2 m/s along x and -1 m/s along y, read without error.
VELOCITY = np.array([2.0, -1.0])


def scan(time: float, sensor: str = "lidar", valid: bool = True) -> Scan:
    measurement = np.array([1.0, 3.0]) + time * VELOCITY
    return Scan(
        time=time,
        sensor=sensor,
        kind="lidar",
        measurement=(measurement if valid else np.full(2, np.nan))[:, None],
        valid=np.array([valid]),
        noise_covariance=np.eye(2) * 0.01,
        sensor_pose=np.zeros(3),
        sensor_velocity=np.zeros(2),
        arrival_time=time,
    )


def estimates(initial: dict[str, object], scans: list[Scan], **options: object) -> list[Estimate]:
    tracker = build(
        FilterConfig.model_validate(
            {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 1.0, "initial": initial, **options}
        )
    ).tracker
    state, found = None, []
    for item in scans:
        state, estimate = tracker.step(state, item)
        found.append(estimate)
    return found


def first_known(found: list[Estimate]) -> int:
    return next(i for i, estimate in enumerate(found) if np.isfinite(estimate.mean).all())


@pytest.mark.parametrize(("source", "needed"), [("first_measurement", 1), ("two_measurements", 3)])
@pytest.mark.parametrize("skip", [0, 1, 3])
def test_skipped_measurements_do_not_start_a_track(source: str, needed: int, skip: int) -> None:
    found = estimates({"from": source, "skip": skip}, [scan(0.1 * k) for k in range(12)])
    assert first_known(found) == skip + needed - 1


def test_start_after_skipping_is_that_of_the_two_readings_that_count() -> None:
    scans = [scan(0.0)._replace(measurement=np.array([[50.0], [50.0]])), scan(0.1), scan(0.3)]
    estimate = estimates({"from": "two_measurements", "least_time_s": 0, "skip": 1}, scans)[-1]
    np.testing.assert_allclose(estimate.mean[:, 0], [1.6, 2.7, *VELOCITY], atol=1e-12)


def test_waiting_at_rest_stands_where_the_latest_measurement_is() -> None:
    scans = [scan(0.0, valid=False), scan(0.1), scan(0.2, valid=False), scan(0.3), scan(0.4)]
    found = estimates({"from": "two_measurements", "least_time_s": 0, "skip": 1, "waiting": "at_rest"}, scans)
    assert np.isnan(found[0].mean).all()
    np.testing.assert_allclose(found[1].mean[:, 0], [1.2, 2.9, 0, 0])
    np.testing.assert_allclose(found[2].mean, found[1].mean)
    np.testing.assert_allclose(found[3].mean[:, 0], [1.6, 2.7, 0, 0])
    np.testing.assert_allclose(np.diag(found[3].covariance[..., 0]), [0.01, 0.01, 400, 400])
    np.testing.assert_allclose(found[4].mean[2:, 0], VELOCITY)


def test_sensors_of_the_start_are_not_updated_with_later() -> None:
    """A track that the radar may start but not correct goes straight on when only the radar reads."""
    options = {"sensors": ["lidar"]}
    scans = [scan(0.0, "other"), scan(0.1, "other"), scan(0.2, "other")._replace(measurement=np.full((2, 1), 99.0))]
    found = estimates({"from": "two_measurements", "least_time_s": 0, "sensors": ["lidar", "other"]}, scans, **options)
    np.testing.assert_allclose(found[2].mean[:, 0], [1.4, 2.8, *VELOCITY], atol=1e-12)
    assert found[2].innovation is None
    assert np.isnan(estimates({"from": "two_measurements", "least_time_s": 0}, scans, **options)[2].mean).all()


@pytest.mark.parametrize("key", ["skip", "waiting", "sensors"])
def test_start_from_the_truth_takes_no_measurements(key: str) -> None:
    value = {"skip": 1, "waiting": "at_rest", "sensors": ["lidar"]}[key]
    with pytest.raises(ValidationError, match="not used with from: truth"):
        estimates({"from": "truth", key: value}, [])


@pytest.mark.parametrize("source", ["first_measurement", "two_measurements"])
def test_a_start_with_the_plain_position_of_a_radar(source: str) -> None:
    measurement = np.array([10.0, 0.5, 1.0])
    radar = Scan(
        time=0.0,
        sensor="radar",
        kind="radar",
        measurement=measurement[:, None],
        valid=np.array([True]),
        noise_covariance=np.diag([0.3, 0.1, 0.1]) ** 2,
        sensor_pose=np.zeros(3),
        sensor_velocity=np.zeros(2),
        arrival_time=0.0,
    )
    scans, plain = [radar, radar._replace(time=1.0, arrival_time=1.0)], 10 * np.array([np.cos(0.5), np.sin(0.5)])
    place = 0 if source == "first_measurement" else -1
    start, biased = (estimates({"from": source, "unbiased": unbiased}, scans)[place] for unbiased in (True, False))
    np.testing.assert_allclose(biased.mean[:2, 0], plain, rtol=1e-12)
    np.testing.assert_allclose(start.mean[:2, 0], plain * np.exp(0.1**2 / 2), rtol=1e-12)
    np.testing.assert_array_equal(biased.covariance[:2, :2], start.covariance[:2, :2])
