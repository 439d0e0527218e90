"""Scans that do not say which detection stems from which object."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.scenes import truth

from trackbench.models.sensors import Lidar, Radar
from trackbench.sensing.hidden import hide_identities
from trackbench.sensing.scans import ideal_sensors, sense
from trackbench.types import Scan

SENSORS = {
    "radar": Radar(
        rate_hz=10, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.1, detection_probability=0.6,
        fov_deg=120, max_range_m=80,
    ),
    "lidar": Lidar(rate_hz=5, position_sigma_m=0.1, detection_probability=0.3),
}  # fmt: skip


def known() -> list[Scan]:
    time = np.arange(40) / 10
    x = 10.0 + 5.0 * np.arange(6)[:, None] + 3.0 * time[:, None, None]
    of = truth(time, x, np.zeros_like(x), np.full_like(x, 3.0), np.zeros_like(x))
    return sense(ideal_sensors(of, SENSORS), 1, "test", range(1)).scans


def test_only_detections_are_left_and_each_once() -> None:
    scans = known()
    hidden = hide_identities(scans, SENSORS, 1, "test", 0)
    assert [(scan.time, scan.sensor) for scan in hidden] == [(scan.time, scan.sensor) for scan in scans]
    counts = set()
    for before, after in zip(scans, hidden, strict=True):
        detections = before.measurement[:, before.valid]
        counts.add(detections.shape[1])
        assert after.measurement.shape == detections.shape
        assert after.valid.shape == (detections.shape[1],)
        assert after.valid.all()
        np.testing.assert_array_equal(*(np.sort(values[0]) for values in (detections, after.measurement)))
        assert {tuple(column) for column in after.measurement.T} == {tuple(column) for column in detections.T}
    assert 0 in counts
    assert max(counts) > 3


def test_the_order_means_nothing_and_is_the_same_for_the_same_run() -> None:
    scans = known()
    first, again, other = (hide_identities(scans, SENSORS, 1, "test", run) for run in (0, 0, 1))
    same = [np.array_equal(a.measurement, b.measurement) for a, b in zip(first, other, strict=True)]
    assert not all(same)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.measurement, b.measurement)
    # Ranges grow with the object's number, so an order that kept identities would be sorted at every scan.
    several = [scan.measurement[0] for scan in first if scan.sensor == "radar" and scan.valid.size > 2]
    assert sum(bool(np.all(np.diff(ranges) > 0)) for ranges in several) < len(several) / 2


def test_what_the_sensor_states() -> None:
    scans = known()
    assert all(
        (scan.detection_probability, scan.clutter_density, scan.field_of_view) == (None, None, None) for scan in scans
    )
    stated = {scan.sensor: scan for scan in hide_identities(scans, SENSORS, 1, "test", 0)}
    assert stated["radar"].detection_probability == 0.6
    assert stated["radar"].clutter_density == 0.0
    assert stated["radar"].field_of_view == (np.deg2rad(60), 80)
    assert stated["lidar"].field_of_view == (np.pi, np.inf)


def test_the_scans_cannot_be_written_into() -> None:
    scan = hide_identities(known(), SENSORS, 1, "test", 0)[0]
    with pytest.raises(ValueError, match="read-only"):
        scan.measurement[:] = 0


def test_a_run_says_that_no_tracker_associates_yet(tiny: Path, cli: Callable[..., Any]) -> None:
    tiny.write_text(tiny.read_text(encoding="utf-8") + "sensing: {identities: hidden}\n", encoding="utf-8")
    assert cli("check", tiny).status == 0
    done = cli("run", tiny)
    assert done.status == 2
    message = "sensing.identities: no tracker here associates detections with objects yet; use identities: known"
    assert done.err == f"{tiny}:18: {message}\n"
    assert not list((tiny.parent / "results").glob("*"))
