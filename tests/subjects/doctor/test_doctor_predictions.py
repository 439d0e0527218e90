"""Motion along the velocity, points drawn from the covariance, two measurements of one instant, and late ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benchmarks.faults.bases.imm_noises import Tracker as Imm
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from benchmarks.faults.bases.ukf_cv import Tracker as Ukf
from tests.support.doctor import under_test

from trackbench.subjects.doctor.checks.instants import late_measurements, same_instant
from trackbench.subjects.doctor.checks.motion import course, no_time
from trackbench.subjects.doctor.checks.start import first_position
from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest


class Changed(PlainEkf):
    """Changes what is returned."""

    def changed(self, x: Any, P: Any) -> Any:
        return x, P

    def step(self, state: Any, scan: Any) -> Any:
        state, (x, P) = super().step(state, scan)
        return state, self.changed(x, P)


class InKmh(Changed):
    """Returns the velocity in km/h."""

    def changed(self, x: Any, P: Any) -> Any:
        unit = np.diag([1.0, 1.0, 3.6, 3.6])
        return unit @ x, unit @ P @ unit


class OtherOrder(Changed):
    """Returns px, vx, py, vy."""

    def changed(self, x: Any, P: Any) -> Any:
        order = [0, 2, 1, 3]
        return x[order], P[np.ix_(order, order)]


class RowsOfRoot(Ukf):
    """Draws points along the rows of the Cholesky factor: from L^T L, not L L^T."""

    def predict(self, mean: Any, covariance: Any, Q: Any, dt: float) -> Any:
        lower = np.linalg.cholesky(covariance)
        return super().predict(mean, lower.T @ lower, Q, dt)


class FirstOfInstant(PlainEkf):
    """Leaves out a scan with the time of its state."""

    def step(self, state: Any, scan: Any) -> Any:
        if state is not None and scan.time == state.time:
            return state, (state.mean, state.covariance)
        return super().step(state, scan)


class Late(PlainEkf):
    """Drops scans that are older than its state."""

    def late(self, state: Any, scan: Any) -> Any:
        return state, (state.mean, state.covariance)

    def step(self, state: Any, scan: Any) -> Any:
        if state is not None and scan.time < state.time:
            return self.late(state, scan)
        return super().step(state, scan)


class AsNew(Late):
    """Takes a late scan for one of the time of its state."""

    def late(self, state: Any, scan: Any) -> Any:
        return super().step(state, scan._replace(time=state.time))


class TimeBack(Late):
    """Stores the time of a late scan with the later state."""

    def late(self, state: Any, scan: Any) -> Any:
        state, estimate = super().step(state, scan._replace(time=state.time))
        return state._replace(time=scan.time), estimate


class StateBack(Late):
    """Predicts back to the time of a late scan, with process noise."""

    def late(self, state: Any, scan: Any) -> Any:
        return PlainEkf.step(self, state, scan)


Check = Callable[[TrackerUnderTest], PartResult]


def late_radar(tracker: TrackerUnderTest) -> PartResult:
    """Ask about late scans as where the scenario says that the radar is late."""
    tracker.assumptions = replace(tracker.assumptions, late={"radar": 0.1})
    return late_measurements(tracker)


@pytest.mark.parametrize(
    ("check", "tracker", "fault", "words"),
    [
        (course, InKmh, "motion_not_along_velocity", "km/h and m/s are confused"),
        (first_position, OtherOrder, "state_order", "is px, vx, py, vy of a target"),
        (no_time, RowsOfRoot, "sigma_points_misdrawn", "along its rows"),
        (same_instant, FirstOfInstant, "second_measurement_dropped", "with the same time does not move"),
        (late_radar, AsNew, "late_processed_as_new", "older by 0.1 s"),
        (late_radar, TimeBack, "late_state_goes_back", "s of its motion"),
        (late_radar, StateBack, "late_state_goes_back", "times that without"),
    ],
)
def test_a_fault_is_named(check: Check, tracker: type, fault: str, words: str) -> None:
    findings = check(under_test(tracker)).findings
    assert {finding.fault for finding in findings} == {fault}
    assert words in findings[0].evidence


@pytest.mark.parametrize("check", [course, no_time, same_instant])
@pytest.mark.parametrize("tracker", [PlainEkf, Ukf, Imm])
def test_a_sound_tracker_has_no_finding(check: Check, tracker: type) -> None:
    assert [one.passed for one in check(under_test(tracker)).checks] == [True]


def test_a_dropped_late_scan_is_no_fault() -> None:
    assert [one.passed for one in late_radar(under_test(Late)).checks] == [True]


def test_nothing_is_asked_of_late_scans_where_no_sensor_is_late() -> None:
    assert late_measurements(under_test(StateBack)).checks == []
