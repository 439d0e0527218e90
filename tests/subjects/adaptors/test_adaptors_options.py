"""How the adaptors start, at which intervals they predict, and what is said of options that do not fit."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests import adapted
from tests.adapted import STATE, measurements
from tests.support.scenes import scan

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.types import Scan
from trackbench.driving.isolation import Isolation
from trackbench.subjects.adaptors.published import filterpy
from trackbench.trackers.published import create

FIXED = {"filter": "tests.adapted:kf_fixed", "state": STATE, "initial": "own", "dt_s": 0.05}
MOVING = {
    "filter": "tests.adapted:ekf",
    "state": STATE,
    "initial": "two_measurements",
    "transition": "tests.adapted:velocity",
    "process_noise": "tests.adapted:velocity_noise",
}
PAIR = {"pair": "tests.adapted:pair", "state": STATE, "initial": "two_measurements"}


#: Of each adaptor, as a scenario has them.
OPTIONS = {
    "filterpy": "{filter: 'tests.adapted:ekf', state: [px, py, vx, vy], initial: own}",
    "stonesoup": "{pair: 'tests.adapted:pair', state: [px, py, vx, vy], initial: own}",
}


def positions(steps: int = 30, every: float = 0.05, missed: tuple[int, ...] = (4, 5, 17)) -> list[Scan]:
    """A lidar at the origin, whose measurements are positions in the fixed frame."""
    random = np.random.default_rng(2)
    times = every * np.arange(steps)
    track = np.array([12 - 6 * times, 6 + 4 * times]) + random.normal(0, 0.15, (2, steps))
    return [scan("lidar", time, track[:, k], k not in missed) for k, time in enumerate(times)]


@pytest.mark.parametrize("columns", [True, False])
@pytest.mark.parametrize("noise", ["stated", "own"])
def test_a_filter_as_it_is_set_runs_as_in_a_loop_of_filterpy(columns: bool, noise: str) -> None:
    sensors = {"lidar": {"measurement": ["x", "y"], "R": noise}}
    tracker = create("filterpy", {**FIXED, "sensors": sensors, "filter_options": {"columns": columns}})()
    by_hand, state = adapted.kf_fixed(columns=columns), None
    for k, seen in enumerate(positions()):
        if k > 0:
            by_hand.predict()
        if seen.valid:
            by_hand.update(seen.measurement, R=seen.noise_covariance if noise == "stated" else None)
        state, estimate = tracker.step(state, seen)
        order = [0, 2, 1, 3]
        np.testing.assert_array_equal(estimate.state, by_hand.x.reshape(-1))
        np.testing.assert_array_equal(estimate.mean, by_hand.x.reshape(-1)[order])
        np.testing.assert_array_equal(estimate.covariance, by_hand.P[np.ix_(order, order)])
        if seen.valid:
            np.testing.assert_array_equal(estimate.innovation, by_hand.y.reshape(-1))
            np.testing.assert_array_equal(estimate.innovation_covariance, by_hand.S)


def test_a_pair_with_a_first_state_starts_from_it() -> None:
    options = {"state": STATE, "initial": "own", "dt_s": 0.05}
    sensors = {"lidar": {"measurement_model": "own", "R": "own"}}
    pair = create("stonesoup", {"pair": "tests.adapted:pair_fixed", **options, "sensors": sensors})()
    kalman = create("filterpy", FIXED)()
    states: list[Any] = [None, None]
    for seen in positions():
        answers = []
        for i, tracker in enumerate((pair, kalman)):
            states[i], answer = tracker.step(states[i], seen)
            answers.append(answer)
        np.testing.assert_allclose(answers[0].mean, answers[1].mean, atol=1e-9)
        np.testing.assert_allclose(answers[0].covariance, answers[1].covariance, atol=1e-9)


def test_an_interval_of_several_dt_is_predicted_in_as_many_steps() -> None:
    by_hand = adapted.kf_fixed(0.01)
    for _ in range(5):
        by_hand.predict()
    first, second = positions(2)
    tracker = filterpy(**{**FIXED, "dt_s": 0.01, "filter_options": {"dt": 0.01}})
    state, _ = tracker.step(None, first._replace(valid=np.array(False)))
    assert state.belief is None
    state = state._replace(belief=adapted.kf_fixed(0.01))
    np.testing.assert_array_equal(
        tracker.step(state, second._replace(valid=np.array(False)))[1].state, by_hand.x.reshape(-1)
    )


@pytest.mark.parametrize(
    ("every", "fits"), [(0.05, True), (0.15, True), (0.050001, True), (0.06, False), (0.01, False)]
)
def test_a_constant_matrix_is_only_used_for_its_own_interval(every: float, fits: bool) -> None:
    tracker, state = filterpy(**FIXED), None
    first, second = positions(2, every, ())
    state, _ = tracker.step(state, first)
    if fits:
        tracker.step(state, second)
        return
    with pytest.raises(TrackbenchError, match=rf"{every:g} s after the last scan is no whole number of dt_s = 0.05 s"):
        tracker.step(state, second)


def test_each_track_has_a_copy_of_an_object() -> None:
    before = adapted.ekf.x.copy()
    for tracker in (create("filterpy", MOVING)(), create("filterpy", MOVING)()):
        state = None
        for seen in measurements(20):
            state, _ = tracker.step(state, seen)
    np.testing.assert_array_equal(adapted.ekf.x, before)


def test_a_first_covariance_that_is_stated_is_in_the_filter_s_order() -> None:
    initial = {"from": "first_measurement", "covariance_diag": [1, 2, 3, 4]}
    _, estimate = filterpy(**{**MOVING, "initial": initial}).step(None, next(measurements()))
    np.testing.assert_array_equal(np.diag(estimate.state_covariance), [1, 2, 3, 4])
    np.testing.assert_array_equal(np.diag(estimate.covariance), [1, 3, 2, 4])


def test_a_component_that_trackbench_does_not_know_starts_as_the_filter_has_it() -> None:
    """And the others start as they do in the built-in filters."""
    options = {**PAIR, "initial": "first_measurement"}
    space = {"pair": "tests.adapted:pair_in_space", "state": [*STATE, "other", "other"]}
    first = next(measurements())
    with_other = create("stonesoup", {**options, **space})().step(None, first)[1]
    without = create("stonesoup", options)().step(None, first)[1]
    np.testing.assert_array_equal(with_other.mean, without.mean)
    np.testing.assert_array_equal(with_other.state_covariance[4:, 4:], 1e-6 * np.eye(2))


def test_only_the_named_sensors_start_a_track() -> None:
    tracker = filterpy(**{**MOVING, "initial": {"from": "first_measurement", "sensors": ["lidar"]}})
    state, answers = None, []
    for seen in measurements(4):
        state, answer = tracker.step(state, seen)
        answers.append(answer)
    assert [answer is None for answer in answers] == [True, False, False, False]


def test_an_object_that_waits_may_stand_where_it_was_read() -> None:
    tracker = filterpy(**{**MOVING, "initial": {"from": "two_measurements", "waiting": "at_rest"}})
    _, estimate = tracker.step(None, next(measurements()))
    np.testing.assert_array_equal(estimate.mean[2:], 0)


@pytest.mark.parametrize(
    ("use", "changes", "message"),
    [
        ("filterpy", {"stat": STATE}, "stat: unknown key; did you mean 'state'?"),
        ("filterpy", {"state": ["px", "vx", "py", "vz"]}, "state: there is no component 'vz': did you mean"),
        ("filterpy", {"state": ["px", "vx", "py", "px"]}, "state: px is named twice"),
        ("filterpy", {"state": ["px", "vx", "py", "ay"]}, "vy is missing"),
        ("filterpy", {"state": ["px", "py", "v", "vx"]}, "vy is missing"),
        ("filterpy", {"state": ["px", "py", "v", "yaw", "ax"]}, "state: ax does not go with v and yaw"),
        ("filterpy", {"state": [*STATE, "ax"]}, "names 5 components, but the filter's x has 4"),
        ("filterpy", {"initial": "two_measurement"}, "initial: did you mean 'two_measurements'?"),
        ("filterpy", {"initial": "truth"}, "initial: choose from: first_measurement, own, two_measurements"),
        ("filterpy", {"initial": {"from": "truth"}}, "initial.from: choose from: first_measurement, two_measurements"),
        ("filterpy", {"initial": {"yaw_sigma_rad": 1}}, "initial.yaw_sigma_rad: the state has no yaw"),
        (
            "filterpy",
            {"initial": {"covariance_diag": [1]}},
            "initial.covariance_diag: the state has 4 components, not 1",
        ),
        ("filterpy", {"filter": "my_filter"}, "filter: 'my_filter' is no name in a module: write \"module:name\""),
        (
            "filterpy",
            {"filter": "tests.adapted:efk"},
            "filter: module 'tests.adapted' has no 'efk': did you mean 'ekf'?",
        ),
        ("filterpy", {"filter": "tests.adaptde:ekf"}, "filter: cannot import 'tests.adaptde:ekf': no module named"),
        ("filterpy", {"filter": "tests.adapted:STATE"}, "gives a list, not one of KalmanFilter, ExtendedKalmanFilter"),
        ("filterpy", {"filter": "tests.adapted:pair"}, "gives a tuple, not one of KalmanFilter"),
        ("filterpy", {"filter": "tests.adapted:radar"}, "filter: 'tests.adapted:radar' raises TypeError"),
        ("filterpy", {"filter_options": {"dt": 1}}, "filter_options: 'tests.adapted:ekf' is an object"),
        ("filterpy", {"transition": None}, "dt_s: missing: the filter's own F holds for one interval only"),
        ("filterpy", {"dt_s": 0.05}, "dt_s: not used beside transition and process_noise; remove it"),
        ("filterpy", {"dt_s": -1}, "dt_s: -1 is not possible: it must be above 0"),
        ("filterpy", {"transition": "tests.adapted:radar"}, "has to take (dt) or (x, dt), not 3 arguments"),
        (
            "filterpy",
            {"transition": "tests.adapted:fails"},
            "transition: 'tests.adapted:fails' raises RuntimeError: no",
        ),
        ("filterpy", {"transition": "tests.adapted:STATE"}, "transition: 'tests.adapted:STATE' is not a function"),
        ("filterpy", {"process_noise": "math:sqrt"}, "gives the shape (), not (4, 4)"),
        ("filterpy", {"transition": None, "fx": "tests.adapted:turn"}, "transition: missing: beside fx"),
        ("filterpy", {"filter": "tests.adapted:kf", "fx": "tests.adapted:turn"}, "fx: not used with KalmanFilter"),
        ("filterpy", {"sensors": {}}, "sensors: must not be empty"),
        ("filterpy", {"sensors": {"radar": {"hc": "a:b"}}}, "sensors.radar.hc: unknown key; did you mean 'hx'?"),
        ("filterpy", {"sensors": {"radar": {"hx": "tests.adapted:radar"}}}, "sensors.radar.HJacobian: missing"),
        ("filterpy", {"sensors": {"radar": {"residual": "a:b"}}}, "sensors.radar.residual: not used without hx"),
        ("filterpy", {"sensors": {"radar": {"hx": "own", "HJacobian": "a:b"}}}, "has none of its own"),
        (
            "filterpy",
            {"sensors": {"radar": {"hx": "tests.adapted:rader", "HJacobian": "tests.adapted:radar_slope"}}},
            "sensors.radar.hx: module 'tests.adapted' has no 'rader': did you mean 'radar'?",
        ),
        (
            "filterpy",
            {"sensors": {"radar": {"z_mean": "a:b", "hx": "a:b"}}},
            "z_mean: not used with ExtendedKalmanFilter",
        ),
        (
            "filterpy",
            {"sensors": {"radar": {"measurement": ["rang"]}}},
            "no sensor reads 'rang': did you mean 'range'?",
        ),
        ("filterpy", {"sensors": {"lidar": {"measurement": ["range"]}}}, "a lidar reads no range"),
        ("filterpy", {"sensors": {"lidar": {"measurement": "x"}}}, "write position, or a list of components"),
        ("filterpy", {"sensors": {"radar": {"measurement": ["elevation", "range"]}}}, "use R: own"),
        ("filterpy", {"sensors": {"radar": {"args": ["pose"], "hx": "a:b"}}}, "a scan has no 'pose': did you mean"),
        (
            "filterpy",
            {"sensors": {"radar": {"R": "mine"}}},
            "sensors.radar.R: 'mine' is not known; choose from: own, stated",
        ),
        (
            "filterpy",
            {"filter": "tests.adapted:kf", "sensors": {"radar": {"measurement": ["range"]}}},
            "its H has the shape (2, 4), not (1, 4), which maps the state to range",
        ),
        ("stonesoup", {"pair": "tests.adapted:ekf"}, "gives ExtendedKalmanFilter, not a KalmanPredictor"),
        ("stonesoup", {"state": [*STATE, "ax"]}, "names 5 components, but the transition model's state has 4"),
        ("stonesoup", {"initial": "own"}, "gives no first state (a GaussianState), which initial: own needs"),
        ("stonesoup", {"dt_s": 0.1}, "dt_s: not used: the transition model takes any interval"),
        ("stonesoup", {"pair": "tests.adapted:pair_fixed"}, "dt_s: missing: the transition model is time-invariant"),
        ("stonesoup", {"sensors": {"radar": {"R": "own"}}}, "sensors.radar.R: not used without measurement_model"),
        ("stonesoup", {"sensors": {"radar": {"measurement_model": "own"}}}, "the updater has none of its own"),
        (
            "stonesoup",
            {
                "sensors": {
                    "radar": {"measurement_model": "tests.adapted:radar_model", "measurement": ["range", "azimuth"]}
                }
            },
            "sensors.radar.measurement: a CartesianToBearingRangeRate2D measures azimuth, range, range_rate, in this",
        ),
        (
            "stonesoup",
            {"sensors": {"radar": {"measurement_model": "tests.adapted:unknown_model"}}},
            "sensors.radar.measurement: missing: what a TurningRadar measures, in its order, is not known",
        ),
        (
            "stonesoup",
            {"sensors": {"lidar": {"measurement_model": "tests.adapted:lidar_model", "measurement": ["x", "y"]}}},
            "sensors.lidar.pose: 'tests.adapted:lidar_model' cannot be put where the sensor is: use pose: own",
        ),
        (
            "stonesoup",
            {"sensors": {"lidar": {"measurement_model": "tests.adapted:space_lidar_model"}}},
            "is of a state of 6 components, not 4",
        ),
        ("stonesoup", {"sensors": {"lidar": {"measurement_model": "tests.adapted:STATE"}}}, "is no MeasurementModel"),
        (
            "stonesoup",
            {"sensors": {"radar": {"measurement_model": "tests.adapted:radar_model_at", "pose": "own"}}},
            "sensors.radar.pose: not used",
        ),
    ],
)
def test_what_does_not_fit_is_an_input_error(use: str, changes: dict[str, Any], message: str) -> None:
    options = {**(MOVING if use == "filterpy" else PAIR), **changes}
    with pytest.raises(InputError) as caught:
        create(use, options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["state", "initial", "filter"])
def test_nothing_is_taken_for_granted(key: str) -> None:
    with pytest.raises(InputError, match=f"{key}: missing; "):
        create("filterpy", {name: value for name, value in MOVING.items() if name != key})


def test_a_sensor_without_an_entry_is_named() -> None:
    tracker = filterpy(**{**MOVING, "initial": "first_measurement", "sensors": {"lidar": {}, "front_radr": {}}})
    first, lidar, radar = list(measurements(3))
    state, _ = tracker.step(None, first)
    state, _ = tracker.step(state, lidar)
    with pytest.raises(TrackbenchError, match=r"no entry for front_radar \(radar\).*did you mean 'front_radr'"):
        tracker.step(state, radar._replace(sensor="front_radar"))


def test_a_component_that_a_sensor_of_its_own_name_does_not_read() -> None:
    tracker = filterpy(**{**MOVING, "initial": "own", "sensors": {"front": {"measurement": ["range"]}}})
    lidar = list(measurements(2))[1]
    with pytest.raises(TrackbenchError, match="the lidar front reads no range"):
        tracker.step(None, lidar._replace(sensor="front"))


@pytest.mark.parametrize(("use", "name"), [("filterpy", "FilterPy"), ("stonesoup", "Stone Soup")])
def test_a_missing_package_is_named(
    use: str, name: str, tiny: Path, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, use, None)
    # The package is missing in this process alone.
    monkeypatch.setattr(Isolation, "of", lambda self, config: False)
    text = tiny.read_text(encoding="utf-8")
    tiny.write_text(
        text.replace("trackers:\n", f"trackers:\n  mine: {{use: {use}, options: {OPTIONS[use]}}}\n"), encoding="utf-8"
    )
    for command in ("check", "run"):
        outcome = cli(command, tiny)
        assert outcome.status == 2
        assert outcome.err.count("\n") == 1
        assert f'{name} is not installed: pip install "trackbench[{use}]"' in outcome.err
    assert f"needs trackbench[{use}]" in " ".join(cli("list", "trackers").out.split())


def test_the_user_s_module_is_found_beside_the_scenario(tiny: Path, cli: Callable[..., Any]) -> None:
    (tiny.parent / "scenario").mkdir()
    file = tiny.rename(tiny.parent / "scenario" / tiny.name)
    code = "from tests.adapted import ekf as mine, velocity as F, velocity_noise as Q\n"
    (file.parent / "filters_beside.py").write_text(code)
    options = {
        "filter": "filters_beside:mine",
        "transition": "filters_beside:F",
        "process_noise": "filters_beside:Q",
        "initial": "two_measurements",
        "state": f"[{', '.join(STATE)}]",
    }
    settings = ["--set", "trackers.mine.use=filterpy"]
    settings += [word for key, value in options.items() for word in ("--set", f"trackers.mine.options.{key}={value}")]
    for workers in ("1", "2"):
        outcome = cli("run", file, *settings, "--no-recording", "--workers", workers)
        assert outcome.status == 0, outcome.err
        assert "mine" in outcome.out
