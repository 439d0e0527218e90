"""What trackers do beside filtering, with kernels as with NumPy: starts, late scans, several sensors, lost courses."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.engine import agreement
from tests.engine.agreement import Drive, drive
from tests.support.late_scans import swapped, taken

from trackbench.base.types import Estimate, Scan
from trackbench.trackers.config import LateMethod
from trackbench.trackers.filtered import FilterTracker, SmoothedTracker
from trackbench.trackers.late import LateScans

pytestmark = pytest.mark.usefixtures("kernels")
#: Of what is not as well conditioned as a step: a fit to a few measurements, a course that nothing is known of, the
#: inverse of a covariance.
ROUGH_LIMIT = 1e-10
FIRST = {"from": "first_measurement", "velocity_sigma_mps": 10}
TWO = {"from": "two_measurements", "least_time_s": 0.3}
DEFAULT = {"velocity_sigma_mps": 15}


@pytest.fixture(scope="module")
def given() -> Drive:
    return drive(30, 17, ["radar", "lidar"])


def both(name: str, given: Drive, initial: dict[str, Any] | None, **changes: Any) -> tuple[FilterTracker, ...]:
    """A tracker by NumPy and by kernels."""
    of = replace(given.tracker(name, initial=initial), **changes)
    return of, replace(of, engine="fused")


def compared(pair: tuple[FilterTracker, ...], scans: list[Scan], limit: float) -> list[tuple[Any, Estimate]]:
    """The states and estimates by NumPy, once those by kernels are found to be the same."""
    of, fused = pair
    angular = tuple(motion.angular for motion in of.filter.motions)
    state = other = None
    found = []
    for scan in scans:
        state, said = of.step(state, scan)
        other, by_kernels = fused.step(other, scan)
        np.testing.assert_array_equal(other.started, state.started)
        assert agreement.apart(other.belief, state.belief, angular) < limit
        assert agreement.of_estimates(by_kernels, said) < limit
        assert (other.fallback is None) == (state.fallback is None)
        found.append((state, said))
    assert fused.engine_used.engine != "numpy"
    assert fused.engine_used.why_numpy == ""
    return found


STARTS: dict[str, tuple[str, dict[str, Any] | None, float]] = {
    "truth": ("ekf-ctrv", None, agreement.LIMIT),
    "first": ("ekf-cv", FIRST, agreement.LIMIT),
    "first, at rest before": ("ekf-cv", {**FIRST, "skip": 2, "waiting": "at_rest"}, agreement.LIMIT),
    "first, by range rate": ("ekf-cv", {**FIRST, "velocity": "range_rate"}, agreement.LIMIT),
    "two": ("ekf-cv", TWO, agreement.LIMIT),
    "default with a yaw": ("ukf-ctrv", DEFAULT, ROUGH_LIMIT),
    "default of several models": ("ekf-imm", DEFAULT, ROUGH_LIMIT),
    "default of a stated noise": ("ekf-ca-diagonal", DEFAULT, ROUGH_LIMIT),
}


@pytest.mark.parametrize("start", STARTS)
def test_starts(start: str, given: Drive) -> None:
    name, initial, limit = STARTS[start]
    found = compared(both(name, given, initial), given.scans, limit)
    assert np.all(found[-1][0].started)


@pytest.mark.parametrize("late", ["drop", "as_new", "replay"])
def test_late_scans(late: LateMethod, given: Drive) -> None:
    scans = [scan._replace(place=k % 2, arrival_time=scan.time + 0.05) for k, scan in enumerate(given.scans)]
    swap = swapped(scans, 5, 11, 12, 20)
    expected, found = (taken(LateScans(each, late, 0.5), swap) for each in both("ekf-cv", given, FIRST))
    for one, other in zip(expected, found, strict=True):
        assert agreement.of_estimates(other, one) < agreement.LIMIT


@pytest.mark.parametrize("advance_at", ["own_scans", "all_scans"])
def test_a_tracker_that_reads_one_of_two_sensors(advance_at: str, given: Drive) -> None:
    pair = both("ukf-ca", given, {**FIRST, "sensors": ["lidar"]}, sensors=["radar"], advance_at=advance_at)
    compared(pair, given.scans, agreement.LIMIT)


def test_scans_at_which_it_is_only_asked(given: Drive) -> None:
    scans = [scan._replace(asked=k % 5 == 3) for k, scan in enumerate(given.scans)]
    compared(both("ekf-imm", given, None), scans, agreement.LIMIT)


def test_tracks_that_lose_their_course() -> None:
    """Objects that stop: their tracks go on with position and velocity, and find their course again."""
    moving, at = drive(40, 12, ["lidar"], speeds=(3.0, 4.0)), 15
    here = moving.scans[at].measurement
    scans = [
        scan if k < at else scan._replace(measurement=here + 0.1 * np.random.default_rng(k).normal(size=here.shape))
        for k, scan in enumerate(moving.scans)
    ]
    scans = [scan._replace(valid=np.isfinite(scan.measurement[0])) for scan in scans]
    found = compared(both("ekf-ctrv", moving, DEFAULT), scans, 1e-9)
    lost = [0 if state.fallback is None else int(state.fallback.where.sum()) for state, _ in found]
    assert max(lost) > 3


@pytest.mark.parametrize("name", ["ekf-cv", "ukf-ctrv", "ekf-imm"])
def test_smoothers(name: str, given: Drive) -> None:
    of, fused = both(name, given, None)
    smoother = SmoothedTracker(fused)
    expected, said = SmoothedTracker(of).estimates(given.scans), smoother.estimates(given.scans)
    for one, other in zip(said, expected, strict=True):
        assert agreement.of_estimates(one, other) < ROUGH_LIMIT
    by_numpy = "smoothing: smoothers are computed by NumPy"
    assert smoother.tracker.engine_used[:3] == ("fused and numpy", by_numpy, 0)


COPIES: dict[str, Callable[[FilterTracker], FilterTracker]] = {
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
    "pickle": lambda of: pickle.loads(pickle.dumps(of)),
    "replace": lambda of: replace(of, cartesian_fallback="at_start"),
    "reading_only": lambda of: of.reading_only(["radar", "lidar"]),
}


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("name", ["ekf-cv", "ekf-imm"])
def test_copies_go_on_where_the_tracker_is(how: str, name: str, given: Drive) -> None:
    _, fused = both(name, given, None)
    state = None
    for scan in given.scans[:10]:
        state, _ = fused.step(state, scan)
    other, again = COPIES[how](fused), pickle.loads(pickle.dumps(state))
    for scan in given.scans[10:15]:
        state, said = fused.step(state, scan)
        again, found = other.step(again, scan)
        for one, two in zip(found, said, strict=True):
            assert (one is None) == (two is None)
            assert one is None or one.tobytes() == two.tobytes()
    assert other.engine_used[:3] == fused.engine_used[:3] == ("fused", "", 0)
