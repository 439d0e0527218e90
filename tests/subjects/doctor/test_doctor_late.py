"""The doctor tells who takes a late measurement for a new one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from tests.support.scenes import NOISE, tracker

from trackbench.base.types import Scan
from trackbench.models.sensors import Lidar, Radar
from trackbench.subjects.doctor.checks.instants import late_measurements
from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.probes import GENERAL, PASSING, Probes
from trackbench.subjects.doctor.site import simplified
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.raw import RawTracker

SENSORS = {
    "radar": Radar(
        rate_hz=20, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.2, latency_s=[0.05, 0.2]
    ),
    "lidar": Lidar(rate_hz=10, position_sigma_m=0.15, latency_s=0.1),
}
FEW = Probes(general=GENERAL[:1], passing=PASSING[:1], moving=())
KEYS: dict[str, dict[str, Any]] = {
    "ekf": {"filter": "ekf", "motion": "cv", **NOISE["cv"]},
    "ukf": {"filter": "ukf", "motion": "ctrv", **NOISE["ctrv"]},
}


class Clamped:
    """A Kalman filter that predicts over no time where a scan is older than its state, and takes it in."""

    batched = True

    def __init__(self) -> None:
        self.filter = tracker(**KEYS["ekf"])

    def step(self, state: Any, scan: Scan) -> Any:
        inner, time = state or (None, scan.time)
        after, estimate = self.filter.step(inner, scan._replace(time=max(scan.time, time), asked=False))
        return (after, max(scan.time, time)), (estimate.mean, estimate.covariance)


class Refusing(Clamped):
    """One that does not take it."""

    def step(self, state: Any, scan: Scan) -> Any:
        if state is not None and scan.time < state[1]:
            raise ValueError("a scan of the past")
        return super().step(state, scan)


def examined(make: Callable[[], Any], **latency: float) -> PartResult:
    sensors = {name: simplified(sensor) for name, sensor in SENSORS.items()}
    return late_measurements(TrackerUnderTest(make, sensors, [], FEW, 0, latency))


@pytest.mark.parametrize("method", ["replay", "retrodiction", "drop"])
@pytest.mark.parametrize("name", KEYS)
def test_who_knows_when_a_measurement_was_taken_has_nothing(name: str, method: str) -> None:
    found = examined(partial(tracker, **KEYS[name], late=method), radar=0.2, lidar=0.1)
    assert found.findings == []
    assert [check.passed for check in found.checks] == [True, True]


@pytest.mark.parametrize(
    "make", [*(partial(tracker, **keys, late="as_new") for keys in KEYS.values()), Clamped], ids=[*KEYS, "clamped"]
)
def test_who_takes_it_for_new_is_named(make: Callable[[], Any]) -> None:
    found = examined(make, radar=0.2, lidar=0.1)
    assert [(one.fault, one.sensor) for one in found.findings] == [
        ("late_processed_as_new", "radar"),
        ("late_processed_as_new", "lidar"),
    ]
    assert "as if new" in found.findings[0].evidence


def test_who_raises_is_told_so_and_has_no_fault() -> None:
    (check,) = examined(Refusing, lidar=0.1).checks
    assert check.passed is None
    assert check.result.startswith("it raises at a scan that is older by 0.1 s than the one before: ")
    assert "a scan of the past" in check.result
    assert examined(Refusing, lidar=0.1).findings == []


def test_only_sensors_that_are_late_are_tried() -> None:
    assert examined(Clamped).checks == []
    assert examined(RawTracker, lidar=0.1).findings == []


def test_a_late_sensor_of_the_scenario_is_tried_at_its_latency() -> None:
    assert SENSORS["radar"].latency == (0.05, 0.2)
    assert simplified(SENSORS["radar"]).latency == (0.0, 0.0)
    assert np.ptp(SENSORS["lidar"].latency) == 0
