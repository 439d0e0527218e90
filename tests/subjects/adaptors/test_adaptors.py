"""Filters of FilterPy and Stone Soup, named in a scenario, give the estimates of the built-in ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from tests.adapted import STATE, TURNING_STATE, measurements
from tests.support.peers import ACCELERATION_SIGMA, YAW_ACCELERATION_SIGMA
from tests.support.scenes import tracker

from trackbench.base.types import Array, Estimate, Scan
from trackbench.base.units import difference
from trackbench.subjects.adaptors.published import filterpy, stonesoup
from trackbench.testing import check_tracker
from trackbench.trackers.answers import Tracker

CV = {"motion": "cv", "acceleration_sigma_mps2": ACCELERATION_SIGMA}
CTRV = {
    "motion": "ctrv",
    "acceleration_sigma_mps2": ACCELERATION_SIGMA,
    "yaw_acceleration_sigma_radps2": YAW_ACCELERATION_SIGMA,
}
MOVES = {"state": STATE, "transition": "tests.adapted:velocity", "process_noise": "tests.adapted:velocity_noise"}
TURNS = {"state": TURNING_STATE, "process_noise": "tests.adapted:turn_noise"}
RADAR = {
    "hx": "tests.adapted:radar",
    "HJacobian": "tests.adapted:radar_slope",
    "residual": "tests.adapted:radar_residual",
    "args": ["sensor_pose", "sensor_velocity"],
}
LIDAR = {"hx": "tests.adapted:lidar", "HJacobian": "tests.adapted:lidar_slope", "args": ["sensor_pose"]}
UNSCENTED = {
    "radar": {
        "hx": "own",
        "residual": "tests.adapted:radar_residual",
        "z_mean": "tests.adapted:radar_mean",
        "args": ["sensor_pose", "sensor_velocity"],
    },
    "lidar": {"hx": "tests.adapted:turning_lidar", "args": ["sensor_pose"]},
}
PLACED = {
    "radar": {"measurement_model": "tests.adapted:radar_model"},
    "lidar": {"measurement_model": "tests.adapted:lidar_model"},
}
SPACE = {
    "radar": {"measurement_model": "own", "R": "own"},
    "lidar": {"measurement_model": "tests.adapted:space_lidar_model"},
}

#: The options of each adapted tracker, and the keys of the built-in one that runs the same filter.
CASES: dict[str, tuple[Any, dict[str, Any], dict[str, Any]]] = {
    "kf": (filterpy, {"filter": "tests.adapted:kf", **MOVES}, {"filter": "kf", **CV}),
    "ekf": (filterpy, {"filter": "tests.adapted:ekf", **MOVES}, {"filter": "ekf", **CV}),
    "ekf_row": (filterpy, {"filter": "tests.adapted:ekf_row", **MOVES}, {"filter": "ekf", **CV}),
    "ekf_own": (
        filterpy,
        {"filter": "tests.adapted:ekf", **MOVES, "sensors": {"radar": RADAR, "lidar": LIDAR}},
        {"filter": "ekf", **CV},
    ),
    "ekf_turning": (
        filterpy,
        {
            "filter": "tests.adapted:ekf_turning",
            **TURNS,
            "transition": "tests.adapted:turn_slope",
            "fx": "tests.adapted:turn",
        },
        {"filter": "ekf", **CTRV},
    ),
    "ukf": (filterpy, {"filter": "tests.adapted:ukf", **TURNS}, {"filter": "ukf", "augmented": False, **CTRV}),
    "ukf_own": (
        filterpy,
        {"filter": "tests.adapted:ukf", **TURNS, "sensors": UNSCENTED},
        {"filter": "ukf", "augmented": False, **CTRV},
    ),
    "pair": (stonesoup, {"pair": "tests.adapted:pair", "state": STATE}, {"filter": "ekf", **CV}),
    "pair_unscented": (
        stonesoup,
        {"pair": "tests.adapted:pair_unscented", "state": ["px", "py", "vx", "vy"]},
        {"filter": "ukf", "augmented": False, **CV},
    ),
    "pair_square_root": (
        stonesoup,
        {"pair": "tests.adapted:pair_square_root", "state": STATE},
        {"filter": "ekf", **CV},
    ),
    "pair_placed": (
        stonesoup,
        {"pair": "tests.adapted:pair", "state": STATE, "sensors": PLACED},
        {"filter": "ekf", **CV},
    ),
    "pair_scanned": (
        stonesoup,
        {
            "pair": "tests.adapted:pair",
            "state": STATE,
            "sensors": {"radar": {"measurement_model": "tests.adapted:radar_model_at", "R": "own"}, "lidar": {}},
        },
        {"filter": "ekf", **CV},
    ),
    "pair_in_space": (
        stonesoup,
        {"pair": "tests.adapted:pair_in_space", "state": [*STATE, "other", "other"], "sensors": SPACE},
        {"filter": "ekf", **CV},
    ),
}


def estimates(of: Tracker, scans: list[Scan]) -> list[Estimate | None]:
    state, result = None, []
    for seen in scans:
        state, estimate = of.step(state, seen)
        result.append(estimate)
    return result


@pytest.mark.parametrize("initial", ["first_measurement", "two_measurements"])
@pytest.mark.parametrize("case", CASES)
@pytest.mark.filterwarnings("ignore::scipy.linalg.LinAlgWarning")
def test_the_estimates_are_those_of_the_built_in_filter(case: str, initial: str) -> None:
    make, options, keys = CASES[case]
    scans = list(measurements(60))
    start = {"from": initial, "least_time_s": 0} if initial == "two_measurements" else initial
    theirs = estimates(make(**options, initial=start), scans)
    # Adapted filters start in their own state.
    ours = estimates(replace(tracker(**keys, initial=start), cartesian_fallback="never"), scans)
    assert sum(answer is not None for answer in theirs) >= len(scans) - 2
    for seen, their, our in zip(scans, theirs, ours, strict=True):
        assert our is not None
        if their is None:
            assert np.isnan(our.mean).all()
            continue
        np.testing.assert_allclose(their.mean, our.mean, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(their.covariance, our.covariance, rtol=1e-4, atol=1e-5)
        assert (their.innovation is None) == (not seen.valid or np.isnan(our.innovation).any())
        if their.innovation is not None:
            np.testing.assert_allclose(nis(their), nis(our), rtol=1e-3, atol=1e-6)


def nis(answer: Estimate) -> float:
    """The innovation squared in its own covariance: the same in every order and frame of its components."""
    return float(answer.innovation @ np.linalg.solve(answer.innovation_covariance, answer.innovation))


@pytest.mark.parametrize("case", ["kf", "ekf_own", "ekf_turning", "ukf_own", "pair", "pair_in_space"])
def test_the_contract_of_a_tracker_is_kept(case: str) -> None:
    make, options, _ = CASES[case]
    check_tracker(make.__name__, **options, initial="two_measurements")


def slopes(call: Callable[[Array], Array], at: Array, step: float = 1e-5) -> Array:
    """``(m, n)`` central differences."""
    shifts = step * np.eye(len(at))
    return np.array([(call(at + shift) - call(at - shift)) / (2 * step) for shift in shifts]).T


def in_motion(of: Tracker, scans: list[Scan]) -> Iterator[tuple[Any, Estimate, Scan]]:
    """State and estimate before each scan that moves the time on."""
    state = None
    for seen in scans:
        before, (state, _) = state, of.step(state, seen)
        if before is not None and before.belief is not None and seen.time > before.time:
            yield before, of.step(before, seen._replace(time=before.time, valid=np.array(False)))[1], seen


@pytest.mark.parametrize("case", CASES)
@pytest.mark.filterwarnings("ignore::scipy.linalg.LinAlgWarning")
def test_the_models_that_are_shown_have_the_slopes_that_are_shown(case: str) -> None:
    make, options, _ = CASES[case]
    of = make(**options, initial="two_measurements")
    shown = [f"{name}_jacobian" for name in ("transition", "measurement") if hasattr(of, f"{name}_jacobian")]
    assert len(shown) == (0 if case.startswith("ukf") else 2)
    for before, now, seen in in_motion(of, list(measurements(40))):
        dt = seen.time - before.time
        for name, argument in (("transition", dt), ("measurement", seen)):
            if f"{name}_jacobian" in shown:
                model = partial(lambda x, call, given: call(x, given), call=getattr(of, name), given=argument)
                slope = getattr(of, f"{name}_jacobian")(now.state, argument)
                np.testing.assert_allclose(slope, slopes(model, now.state), atol=1e-5)


@pytest.mark.parametrize("case", ["kf", "ekf", "ekf_own", "ekf_turning", "pair", "pair_scanned"])
def test_the_models_that_are_shown_are_those_that_run(case: str) -> None:
    make, options, _ = CASES[case]
    of = make(**options, initial="two_measurements")
    for before, now, seen in in_motion(of, list(measurements(40))):
        x = of.transition(now.state, seen.time - before.time)
        predicted = of.step(before, seen._replace(valid=np.array(False)))[1]
        np.testing.assert_allclose(predicted.state, x, atol=1e-9)
        if seen.valid and case in ("ekf", "ekf_own", "ekf_turning", "pair"):
            expected, angular = of.measurement(x, seen), (1,) if seen.kind == "radar" else ()
            innovation = of.step(before, seen)[1].innovation
            np.testing.assert_allclose(innovation, difference(seen.measurement, expected, angular), atol=1e-9)
