"""False alarms: Poisson in number, uniform in the field of view or at stated places, and apart from everything else."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy import stats
from tests.support.scenes import truth

from trackbench.base.types import FALSE_ALARM, Array, Observer, Truth, scan_of_run
from trackbench.models.sensors import Lidar, Radar, Sensor
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import Measurements, ideal_sensors

RADAR: dict[str, Any] = {
    "rate_hz": 10, "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1, "fov_deg": 100,
    "max_range_m": 80,
}  # fmt: skip
LIDAR: dict[str, Any] = {"rate_hz": 10, "position_sigma_m": 0.1, "fov_deg": 200, "max_range_m": 60}
STEPS = 300


def scene(observer: Observer | None = None) -> Truth:
    """One car at rest, 30 m ahead."""
    at = np.full((STEPS, 1, 1), 30.0)
    return truth(np.arange(STEPS) / 10, at, 0 * at, 0 * at, 0 * at, observer=observer)


def found(sensor: Sensor, runs: int = 10, of: Truth | None = None) -> Measurements:
    return sense_hidden(ideal_sensors(of or scene(), {"sensor": sensor}), 5, "clutter", range(runs))


def alarms(measurements: Measurements) -> Array:
    """``(m, n)`` of all runs and scans."""
    parts = [scan.measurement[:, origins == FALSE_ALARM] for scan, origins in _paired(measurements)]
    return np.concatenate(parts, axis=1)


def _paired(measurements: Measurements) -> list[tuple[Any, Any]]:
    return list(zip(measurements.scans, measurements.origins, strict=True))


def objects(measurements: Measurements) -> dict[tuple[int, int, int], bytes]:
    """The detection of each object, by scan, run and object."""
    return {
        (k, run, int(origins[column, run])): scan.measurement[:, column, run].tobytes()
        for k, (scan, origins) in enumerate(_paired(measurements))
        for column, run in zip(*np.nonzero(origins >= 0), strict=True)
    }


@pytest.mark.parametrize("per_scan", [0.5, 4.0, 10.0])
def test_the_number_per_scan_is_poisson(per_scan: float) -> None:
    measurements = found(Radar(clutter={"per_scan": per_scan}, **RADAR))
    counts = np.concatenate([(origins == FALSE_ALARM).sum(axis=0) for origins in measurements.origins])
    # Bins of at least ten expected; the tails are lumped.
    values = np.arange(60)
    expected = stats.poisson(per_scan).pmf(values) * len(counts)
    kept = expected >= 10
    observed = np.bincount(counts, minlength=60)[:60]
    lumped = [np.append(numbers[kept], len(counts) - numbers[kept].sum()) for numbers in (observed, expected)]
    assert stats.chisquare(*lumped).pvalue > 1e-3


def test_a_radars_are_uniform_in_range_azimuth_and_range_rate() -> None:
    z = alarms(found(Radar(clutter={"per_scan": 10, "range_rate_mps": [-40, 20]}, **RADAR)))
    lowest, highest = [0, -np.deg2rad(50), -40], [80, np.deg2rad(50), 20]
    share = (z - np.array(lowest)[:, None]) / (np.array(highest) - lowest)[:, None]
    counts, _ = np.histogramdd(share.T, bins=5, range=[(0, 1)] * 3)
    assert counts.sum() == z.shape[1]
    assert stats.chisquare(counts.ravel()).pvalue > 1e-3


def test_a_lidars_are_uniform_over_the_area_in_view() -> None:
    x, y = alarms(found(Lidar(clutter={"per_scan": 10}, **LIDAR)))
    share = np.stack([np.hypot(x, y) ** 2 / 60**2, np.arctan2(y, x) / np.deg2rad(200) + 0.5])
    counts, _ = np.histogramdd(share.T, bins=8, range=[(0, 1)] * 2)
    assert counts.sum() == len(x)
    assert stats.chisquare(counts.ravel()).pvalue > 1e-3


def test_the_density_is_the_number_over_the_volume() -> None:
    radar = found(Radar(clutter={"per_scan": 6, "range_rate_mps": [-40, 20]}, **RADAR), 1).scans[0]
    assert radar.clutter_density == pytest.approx(6 / (80 * np.deg2rad(100) * 60))
    lidar = found(Lidar(clutter={"per_scan": 3}, **LIDAR), 1).scans[0]
    assert lidar.clutter_density == pytest.approx(3 / (np.pi * 60**2 * 200 / 360))


def test_the_objects_detections_do_not_depend_on_clutter() -> None:
    keys = {**RADAR, "detection_probability": 0.7}
    rail = {"line": [[0, 5], [60, 5]], "per_scan": 3}
    without, uniform, both = (
        found(Radar(clutter=clutter, **keys)) for clutter in ({}, {"per_scan": 8}, {"per_scan": 8, "places": [rail]})
    )
    assert objects(without) == objects(uniform) == objects(both)
    # Nor do the uniform ones depend on the rail's.
    ours, theirs = ({tuple(column) for column in alarms(of).T} for of in (uniform, both))
    assert ours < theirs


@pytest.mark.parametrize("frame", ["fixed", "observer"])
def test_a_guard_rail_is_where_it_stands_and_at_rest(frame: str) -> None:
    # The observer goes east at 20 m/s: the rail of the world falls behind, that along the road stays beside it.
    time = np.arange(STEPS) / 10
    still = np.zeros(STEPS)
    observer = Observer(20 * time, still, still, np.full(STEPS, 20.0), still, still)
    place = {"line": [[0, 6], [60, 6], [60, 10]], "per_scan": 5, "frame": frame}
    sharp = {**RADAR, "range_sigma_m": 1e-6, "azimuth_sigma_deg": 1e-6, "range_rate_sigma_mps": 1e-6, "fov_deg": 360}
    sensor = Radar(clutter={"places": [place]}, mount={"x_m": 2, "y_m": 1, "yaw_deg": 90}, **sharp)
    measurements = found(sensor, 2, scene(observer))
    along = []
    for k, (scan, origins) in enumerate(_paired(measurements)):
        r, azimuth, rate = scan.measurement[:, origins == FALSE_ALARM]
        angle = azimuth + np.pi / 2
        x, y = 2 + r * np.cos(angle), 1 + r * np.sin(angle)
        np.testing.assert_allclose(rate, -20 * np.cos(angle), atol=1e-4)
        x = x + (2.0 * k if frame == "fixed" else 0.0)
        on_first, on_second = np.abs(y - 6) < 1e-3, np.abs(x - 60) < 1e-3
        assert (on_first | on_second).all()
        along += list(np.where(on_first, x, 60 + y - 6))
        if frame == "fixed":
            assert (r <= 80).all()
    if frame == "observer":
        assert len(along) == pytest.approx(5 * STEPS * 2, abs=4 * np.sqrt(5 * STEPS * 2))
        assert stats.kstest(np.array(along) / 64, "uniform").pvalue > 1e-3


def test_a_silent_sensor_says_that_it_detects_nothing() -> None:
    place = {"line": [[40, 0]], "per_scan": 4}
    dropouts = [{"from_s": 1, "to_s": 2}]
    keys: Mapping[str, Any] = {**RADAR, "clutter": {"per_scan": 10, "places": [place]}}
    quiet, always = found(Radar(dropouts=dropouts, **keys), 1), found(Radar(**keys), 1)
    for one, other in zip(quiet.scans, always.scans, strict=True):
        if 1 <= one.time < 2:
            assert one.measurement.shape == (3, 0, 1)
            assert (one.detection_probability, one.clutter_density) == (0.0, 0.0)
        else:
            np.testing.assert_array_equal(one.measurement, other.measurement)


def test_misstatement_reaches_the_scan_only() -> None:
    keys = {**RADAR, "detection_probability": 0.8, "clutter": {"per_scan": 10}}
    true, stated = (
        found(Radar(**keys)),
        found(Radar(states={"detection_probability": 0.5, "clutter_per_scan": 1}, **keys)),
    )
    assert true.digests == stated.digests
    for one, other in zip(true.scans, stated.scans, strict=True):
        np.testing.assert_array_equal(one.measurement, other.measurement)
        assert one.clutter_density is not None
        assert other.clutter_density == pytest.approx(one.clutter_density / 10)
        assert (one.detection_probability, other.detection_probability) == (0.8, 0.5)


def test_an_empty_scan_is_delivered() -> None:
    nothing = found(Radar(**{**RADAR, "max_range_m": 10}), 3)
    assert len(nothing.scans) == STEPS
    assert all(scan.measurement.shape == (3, 0, 3) for scan in nothing.scans)
    assert scan_of_run(nothing.scans[0], 2).measurement.shape == (3, 0)
