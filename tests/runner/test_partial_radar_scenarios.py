"""Scenarios whose radars measure some of range, azimuth and range rate, from the file to the result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.engine.test_scenarios import differences
from tests.support.exported import write_scenes
from tests.support.scenes import scan, tracker
from tests.support.udacity import data_folder

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.base.types import Estimate, Scan
from trackbench.engine.choice import Engine
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

both_engines = pytest.mark.parametrize("engine", ["numpy", "fused"])
CV = {"motion": "cv", "acceleration_sigma_mps2": 2.0}
EKF = {"filter": "ekf", **CV}
IMM = {
    "filter": "ekf",
    "motion": {
        "stay_s": [5, 5],
        "imm": [{"model": "cv", "acceleration_sigma_mps2": 0.5}, {"model": "ca", "jerk_sigma_mps3": 4}],
    },
}
RANGE_BEARING = {
    "type": "radar",
    "rate_hz": 10,
    "measures": ["azimuth", "range"],
    "range_sigma_m": 0.3,
    "azimuth_sigma_deg": 0.5,
}
BEARING = {"type": "radar", "rate_hz": 10, "measures": ["azimuth"], "azimuth_sigma_deg": 0.3}
WHITE = {"start": {"x": 40, "y": 5, "vx_mps": -3, "vy_mps": 2}, "pieces": [{"white": CV}]}


def scenario(sensors: dict[str, Any], trackers: dict[str, Any], runs: int = 200, **more: Any) -> dict[str, Any]:
    return {
        "name": "partial",
        "truth": {"source": "scripted", "duration_s": 8, "rate_hz": 10, "objects": {"car": WHITE}},
        "sensors": sensors,
        "trackers": trackers,
        "monte_carlo": {"runs": runs, "seed": 5},
        **more,
    }


def result(folder: Path, content: dict[str, Any], **options: Any) -> Result:
    file = folder / "scenario.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    loaded = load_scenario(file)
    return run_scenario(loaded, truths_of(loaded), **options)


def refused(folder: Path, content: dict[str, Any]) -> str:
    with pytest.raises(InputError) as caught:
        result(folder, content)
    return str(caught.value)


def drive(full: bool, range_rate_sigma: float = 0.1, steps: int = 120) -> list[Scan]:
    """Scans of a car that turns across the direction in which the azimuth jumps, seen from a sensor that moves."""
    random, noise = np.random.default_rng(2), np.diag(np.square([0.3, 0.02, range_rate_sigma]))
    scans = []
    for k in range(steps):
        time = 0.1 * k
        target = np.array(
            [-40 + 12 * np.sin(0.3 * time), 15 * np.cos(0.2 * time), 3.6 * np.cos(0.3 * time), -3 * np.sin(0.2 * time)]
        )
        pose, velocity = (2 + 0.5 * time, 1.0, 0.05 * time), (0.5, 0.0)
        ideal = SENSOR_MODELS["radar"].measure(target, np.array(pose), np.array(velocity))
        measurement = ideal + np.array([0.3, 0.02, 0.1]) * random.standard_normal(3)
        rows = 3 if full else 2
        kind = "radar" if full else "radar(range, azimuth)"
        seen = scan(kind, time, measurement[:rows, None], noise=noise[:rows, :rows], pose=pose, velocity=velocity)
        scans.append(seen._replace(sensor="radar"))
    return scans


def estimates(scans: list[Scan], engine: Engine = "numpy", **keys: Any) -> list[Estimate]:
    state, made, given = None, replace(tracker(**keys), engine=engine), []
    for each in scans:
        state, estimate = made.step(state, each)
        given.append(estimate)
    return given


def textbook(scans: list[Scan], mean: np.ndarray, covariance: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """An extended Kalman filter on range and bearing, from the estimate after the first scan."""
    x, p, given, last = mean, covariance, [(mean, covariance)], scans[0].time
    for each in scans[1:]:
        dt, last = each.time - last, each.time
        f, g = np.eye(4) + dt * np.eye(4, k=2), np.vstack([np.eye(2) * dt**2 / 2, np.eye(2) * dt])
        x, p = f @ x, f @ p @ f.T + g @ g.T * CV["acceleration_sigma_mps2"] ** 2
        dx, dy = x[:2] - each.sensor_pose[:2]
        r = np.hypot(dx, dy)
        h = np.array([[dx / r, dy / r, 0, 0], [-dy / r**2, dx / r**2, 0, 0]])
        y = each.measurement[:, 0] - np.array([r, np.arctan2(dy, dx) - each.sensor_pose[2]])
        y[1] = (y[1] + np.pi) % (2 * np.pi) - np.pi
        k = p @ h.T @ np.linalg.inv(h @ p @ h.T + each.noise_covariance)
        x, p = x + k @ y, (np.eye(4) - k @ h) @ p
        given.append((x, p))
    return given


@both_engines
def test_the_ekf_is_that_of_a_textbook(engine: Engine) -> None:
    scans = drive(full=False)
    ours = estimates(scans, engine, **EKF)
    for each, (mean, covariance) in zip(
        ours, textbook(scans, ours[0].mean[:, 0], ours[0].covariance[..., 0]), strict=True
    ):
        np.testing.assert_allclose(each.mean[:, 0], mean, rtol=0, atol=1e-9)
        np.testing.assert_allclose(each.covariance[..., 0], covariance, rtol=0, atol=1e-9)


FILTERS: dict[str, dict[str, Any]] = {
    "ekf": EKF,
    "ukf": {"filter": "ukf", **CV},
    "ckf": {"filter": "ckf", **CV},
    "imm": IMM,
}


@both_engines
@pytest.mark.parametrize("name", FILTERS)
def test_a_range_rate_of_no_information_changes_nothing(name: str, engine: Engine) -> None:
    """The estimates differ by what it still tells, which falls with the square of its standard deviation.

    Sigma points see in its mean what is curved, as much whatever its noise; it is then weighed with that noise.
    """
    start = {"velocity": "zero"}
    part = estimates(drive(full=False), engine, initial=start, **FILTERS[name])
    for sigma in (1e4, 1e5):
        full = estimates(drive(full=True, range_rate_sigma=sigma), engine, initial=start, **FILTERS[name])
        for ours, theirs in zip(part, full, strict=True):
            # The velocity is known to 20 m/s at worst: relative information (20 / sigma)^2 in each scan.
            tolerance = len(part) * (20 / sigma) ** 2
            deviation = np.sqrt(np.einsum("ii...->i...", theirs.covariance))
            assert np.max(np.abs(ours.mean - theirs.mean) / deviation) < tolerance * 20
            assert np.max(np.abs(ours.covariance - theirs.covariance) / (deviation[:, None] * deviation)) < tolerance


def test_a_track_waits_for_a_sensor_that_measures_a_position() -> None:
    made, state = tracker(**EKF), None
    bearing = scan("radar(azimuth)", 0.0, [[0.1, 0.2]], noise=np.eye(1) * 1e-4)
    state, estimate = made.step(state, bearing)
    assert np.isnan(estimate.mean).all()
    placed = scan("radar(range, azimuth)", 0.1, [[50, 60], [0.1, 0.2]], [True, False], noise=np.eye(2) * 1e-4)
    state, estimate = made.step(state, placed)
    np.testing.assert_array_equal(np.isfinite(estimate.mean).all(axis=0), [True, False])
    # As of a lidar, nothing is known of its velocity.
    np.testing.assert_allclose(estimate.covariance[2:, 2:, 0], 400 * np.eye(2))
    state, after = made.step(state, bearing._replace(time=0.1, arrival_time=0.1))
    assert after.covariance[1, 1, 0] < 0.6 * estimate.covariance[1, 1, 0]
    assert np.isnan(after.mean[:, 1]).all()


def test_estimates_are_due_from_the_first_position_on(tmp_path: Path) -> None:
    sensors = {"front": {**RANGE_BEARING, "dropouts": [{"from_s": 0, "to_s": 3}]}, "cam": BEARING}
    given = result(tmp_path, scenario(sensors, {"ekf": EKF}, runs=20))
    assert given["ekf"].coverage.value == 1.0


@pytest.mark.parametrize(
    ("trackers", "message"),
    [
        (
            {"a": EKF},
            "trackers.a.initial: no track can start: none of left (radar(azimuth)) and right (radar(azimuth)) ",
        ),
        ({"a": {**EKF, "sensors": ["left"]}}, "none of left (radar(azimuth)) measures a position; start from a sensor"),
        (
            {"a": {**EKF, "initial": {"sensors": ["right"]}, "sensors": ["left", "right", "lidar"]}},
            "none of right (radar",
        ),
        ({"a": {"filter": "kf", **CV}}, "trackers.a.filter: kf converts measurements to positions, and left (radar(az"),
    ],
)
def test_a_tracker_that_can_never_start_is_refused(tmp_path: Path, trackers: dict[str, Any], message: str) -> None:
    sensors: dict[str, Any] = {"left": BEARING, "right": BEARING}
    if "'kf'" in str(trackers) or "lidar" in str(trackers):
        sensors["lidar"] = {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.2}
    assert message in refused(tmp_path, scenario(sensors, trackers))


CARS = {
    f"car{i}": {"start": {"x": 30 + 12 * i, "y": 8 * i - 12, "vx_mps": 6, "vy_mps": 0.2 * i}, "pieces": [{"white": CV}]}
    for i in range(4)
}
ROAD = {"fov_deg": 120, "max_range_m": 150, "detection_probability": 0.9, "clutter": {"per_scan": 3}}
METHODS = ("gnn", "jipda", "pmb")


def hidden(sensors: dict[str, Any], trackers: dict[str, Any], runs: int, seed: int = 5) -> dict[str, Any]:
    content = scenario(sensors, trackers, runs)
    content["truth"]["objects"] = CARS
    content["monte_carlo"]["seed"] = seed
    return content | {"sensing": {"identities": "hidden"}}


def associated(filter: dict[str, Any], *methods: str) -> dict[str, Any]:
    return {f"{filter['filter']}-{method}": {**filter, "associate": {"method": method}} for method in methods}


def test_every_association_gives_the_same_by_both_engines(tmp_path: Path) -> None:
    sensors = {"front": {**RANGE_BEARING, **ROAD}, "cam": {**BEARING, **ROAD, "fov_deg": 90}}
    trackers = associated(EKF, "gnn", "pmb") | {"imm": {**IMM, "associate": {"method": "pmb"}}}
    numpy, fused = (result(tmp_path, hidden(sensors, trackers, 2), engine=engine) for engine in ("numpy", "fused"))
    assert [tracker.name for tracker in numpy.summary.trackers if tracker.failed] == []
    assert list(differences(fused.summary.model_dump(), numpy.summary.model_dump())) == []
    for name in ("ekf-pmb", "imm"):
        assert numpy[name].metrics["matched_share"].value > 0.95


def test_a_bearing_begins_no_track(tmp_path: Path) -> None:
    sensors = {"cam": {**BEARING, **ROAD}, "front": {**RANGE_BEARING, **ROAD, "dropouts": [{"from_s": 0, "to_s": 100}]}}
    given = result(tmp_path, hidden(sensors, associated(EKF, *METHODS), 2))
    for each in given.summary.trackers:
        assert each.metrics["matched_share"].value == 0.0
        assert each.metrics["false_tracks"].value == 0.0


def test_a_recorded_sensor_states_the_range_of_detection(tmp_path: Path) -> None:
    front = {**RANGE_BEARING, **ROAD, "states": {"half_range_m": 90}}
    file = tmp_path / "scenario.yaml"
    file.write_text(yaml.safe_dump(hidden({"front": front}, associated(EKF, "pmb"), 1)), encoding="utf-8")
    original = load_scenario(file)
    log = load_scenario(write_scenes(tmp_path, original)[0])
    assert log.config.sensors["front"].states.half_range_m == 90
    given, constant = (
        run_scenario(each, truths_of(each))["ekf-pmb"].metrics["gospa"].value
        for each in (log, load_scenario(tmp_path / "log.yaml", ["sensors.front.states.half_range_m=null"]))
    )
    assert given != constant


def test_a_range_of_detection_needs_a_position(tmp_path: Path) -> None:
    sensors = {"front": {**RANGE_BEARING, **ROAD}, "cam": {**BEARING, **ROAD, "states": {"half_range_m": 90}}}
    trackers = associated(
        {**EKF, "assume": {"cam": {"signal_to_noise": {"half_range_m": 90, "stated_at_m": 40}}}}, "pmb"
    )
    assert "sensors.cam.states.half_range_m: a radar(azimuth) measures no position" in refused(
        tmp_path, hidden(sensors, trackers, 1)
    )
    del sensors["cam"]["states"]
    assert "trackers.ekf-pmb.assume.cam.signal_to_noise: a radar(azimuth) measures no position" in refused(
        tmp_path, hidden(sensors, trackers, 1)
    )


@pytest.mark.skipif(not (data_folder() / "udacity").is_dir(), reason="no udacity in TRACKBENCH_DATA")
def test_the_simulators_radar_lines_feed_a_radar_that_measures_less(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_DATA", str(data_folder()))
    full = load_scenario("recorded/udacity_fusion")
    text = full.text.replace("type: radar,", "type: radar, measures: [azimuth, range],")
    (before,) = truths_of(full)
    file = tmp_path / "less.yaml"
    file.write_text(text.replace(", range_rate_sigma_mps: 0.3", ""), encoding="utf-8")
    part = tb.load(file, trackers=["ekf", "ekf_lidar"])
    (after,) = truths_of(part)
    np.testing.assert_array_equal(after.measurements["radar"].measurement, before.measurements["radar"].measurement[:2])
    given = run_scenario(part, [after])
    assert given["ekf"].position_rmse.value < given["ekf_lidar"].position_rmse.value
