"""Sensors of users: compiled where a trace says all of them, and computed by NumPy where not."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.engine import agreement
from tests.engine.agreement import drive
from tests.support.scenes import tracker

from trackbench.base.types import Estimate, Scan
from trackbench.engine.equations import EngineUsed
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.filtered import FilterTracker

pytestmark = pytest.mark.usefixtures("kernels")
FIRST = {"from": "first_measurement", "velocity_sigma_mps": 10}
OWN = "tests.engine.own_sensors"


def scans(kind: str) -> list[Scan]:
    """Those of a lidar; or of a radar without its range rate, for a sonar."""
    if kind != "Sonar":
        return [scan._replace(kind=f"{OWN}:{kind}") for scan in drive(12, 9, ["lidar"]).scans]
    noise = np.diag([0.3, 0.02]) ** 2
    seen = drive(12, 9, ["radar"]).scans
    return [
        scan._replace(kind=f"{OWN}:Sonar", measurement=scan.measurement[:2], noise_covariance=noise) for scan in seen
    ]


def estimates(of: FilterTracker, given: list[Scan]) -> list[Estimate]:
    state, said = None, []
    for scan in given:
        state, estimate = of.step(state, scan)
        said.append(estimate)
    return said


def pair(name: str, given: list[Scan]) -> tuple[float, EngineUsed]:
    """How far the engines are apart, and what computed the fused one."""
    of = tracker(**agreement.FILTERS[name], initial=FIRST)
    by_kernels = FilterTracker(of.filter, of.initial, engine="fused")
    said = zip(estimates(by_kernels, given), estimates(of, given), strict=True)
    largest = max(agreement.difference(one.mean, two.mean, 1.0) for one, two in said)
    return largest, by_kernels.engine_used


@pytest.mark.parametrize("name", ["kf-cv", "ekf-cv", "ukf-cv"])
def test_a_sensor_of_arithmetic_alone_is_compiled(name: str) -> None:
    largest, used = pair(name, scans("Sonar"))
    assert used == EngineUsed("fused")
    assert largest < agreement.LIMIT


@pytest.mark.parametrize(("kind", "why"), [("Drifting", "NoneType"), ("Named", "give different numbers")])
def test_a_sensor_that_reads_more_of_a_scan_is_computed_by_numpy(kind: str, why: str) -> None:
    """Where the Kalman filter asks it for a position."""
    largest, used = pair("kf-cv", scans(kind))
    assert why in used.why_numpy
    assert largest == 0.0
    assert pair("ekf-cv", scans(kind))[1] == EngineUsed("fused")


def test_a_sensor_that_is_edited_has_its_new_equations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As soon as it is looked up again, also by the tracker that runs."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    text = """
from tests.engine.own_sensors import Lidar
class Edited(Lidar):
    pure = True
    @classmethod
    def measure(cls, target, pose, velocity):
        return super().measure(target, pose, velocity) + {shift}
"""
    given = [scan._replace(kind="edited_sensor:Edited") for scan in drive(12, 9, ["lidar"]).scans]
    of = tracker(**agreement.FILTERS["ekf-cv"], initial=FIRST)
    both = of, FilterTracker(of.filter, of.initial, engine="fused")
    states = [None, None]
    try:
        for shift, part in ((0.0, given[:6]), (0.5, given[6:])):
            (tmp_path / "edited_sensor.py").write_text(text.format(shift=shift))
            importlib.invalidate_caches()
            if "edited_sensor" in sys.modules:
                importlib.reload(sys.modules["edited_sensor"])
            SENSOR_MODELS.get("edited_sensor:Edited")
            for scan in part:
                pairs = [each.step(state, scan) for each, state in zip(both, states, strict=True)]
                states = [state for state, _ in pairs]
                expected, said = (estimate.mean for _, estimate in pairs)
                assert agreement.difference(said, expected, 1.0) < agreement.LIMIT
        assert both[1].engine_used == EngineUsed("fused")
    finally:
        sys.modules.pop("edited_sensor", None)
