"""Scans that do not say which detection stems from which object."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.scenes import truth

from trackbench.base.types import scan_of_run
from trackbench.models.sensors import Lidar, Radar
from trackbench.sensing.detections import PADDING, sense_hidden
from trackbench.sensing.scans import IdealSensor, Measurements, ideal_sensors, sense_known

SENSORS = {
    "radar": Radar(
        rate_hz=10, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.1, detection_probability=0.6,
        fov_deg=120, max_range_m=80,
    ),
    "lidar": Lidar(rate_hz=5, position_sigma_m=0.1, detection_probability=0.3),
}  # fmt: skip


def ideal() -> list[IdealSensor]:
    time = np.arange(40) / 10
    x = 10.0 + 5.0 * np.arange(6)[:, None] + 3.0 * time[:, None, None]
    of = truth(time, x, np.zeros_like(x), np.full_like(x, 3.0), np.zeros_like(x))
    return ideal_sensors(of, SENSORS)


def known(runs: range = range(1)) -> Measurements:
    return sense_known(ideal(), 1, "test", runs)


def hidden(runs: range = range(1)) -> Measurements:
    return sense_hidden(ideal(), 1, "test", runs)


def test_only_detections_are_left_and_each_once() -> None:
    counts = set()
    found = hidden(range(3))
    for before, after, origin in zip(known(range(3)).scans, found.scans, found.origins, strict=True):
        assert (before.time, before.sensor) == (after.time, after.sensor)
        measurement, valid = before.measurement.reshape(-1, 6, 3), before.valid.reshape(6, 3)
        for run in range(3):
            detections, one = measurement[:, valid[:, run], run], scan_of_run(after, run)
            counts.add(detections.shape[1])
            assert one.measurement.shape == detections.shape
            assert one.valid.shape == (detections.shape[1],)
            assert one.valid.all()
            own = origin[after.valid[:, run], run]
            assert sorted(own) == list(np.flatnonzero(valid[:, run]))
            np.testing.assert_array_equal(one.measurement, measurement[:, own, run])
    assert 0 in counts
    assert max(counts) > 3


def test_a_block_pads_each_run_at_its_end() -> None:
    found = hidden(range(5))
    for scan, origins, merged in zip(found.scans, found.origins, found.merged, strict=True):
        counts = scan.valid.sum(axis=0)
        assert scan.measurement.shape[1:] == scan.valid.shape == origins.shape == merged.shape == (counts.max(), 5)
        np.testing.assert_array_equal(scan.valid, np.arange(counts.max())[:, None] < counts)
        assert np.isnan(scan.measurement[:, ~scan.valid]).all()
        assert (origins[~scan.valid] == PADDING).all()
        assert (origins[scan.valid] >= 0).all()
        assert (merged == -1).all()


def test_the_order_means_nothing() -> None:
    # Ranges grow with the object's number, so an order that kept identities would be sorted at every scan.
    scans = [scan_of_run(scan, run) for run in range(20) for scan in hidden(range(20)).scans if scan.sensor == "radar"]
    several = [scan.measurement[0] for scan in scans if scan.valid.size == 3]
    ascending = np.array([bool(np.all(np.diff(ranges) > 0)) for ranges in several])
    assert len(several) > 100
    assert abs(ascending.mean() - 1 / 6) < 4 * np.sqrt(5 / 36 / len(several))


def test_what_the_sensor_states() -> None:
    assert all(
        (scan.detection_probability, scan.clutter_density, scan.field_of_view) == (None, None, None)
        for scan in known().scans
    )
    stated = {scan.sensor: scan for scan in hidden().scans}
    assert stated["radar"].detection_probability == 0.6
    assert stated["radar"].clutter_density == 0.0
    low, high = SENSORS["radar"].clutter.range_rate_mps
    assert stated["radar"].field_of_view == (np.deg2rad(60), 80, pytest.approx(80 * np.deg2rad(120) * (high - low)))
    assert stated["lidar"].field_of_view == (np.pi, np.inf, None)


def test_the_scans_cannot_be_written_into() -> None:
    scan = hidden().scans[0]
    for one in (scan, scan_of_run(scan, 0)):
        with pytest.raises(ValueError, match="read-only"):
            one.measurement[:] = 0
