"""A truth from recorded traffic: observers, scenes, smoothing, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError
from tests.support.traffic_files import CARS, TIME, write_csv

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.base.types import EXACT, Truth
from trackbench.metrics.evaluate import widen_for_reference
from trackbench.results import MetricValue
from trackbench.runner.work import Work
from trackbench.scenario import load_scenario
from trackbench.scenario.check import check
from trackbench.scenario.truth import truths_of
from trackbench.truth import traffic
from trackbench.truth.config.traffic import Smoothing
from trackbench.truth.smoothing import smoothed
from trackbench.truth.sources import TrafficTruth

SMOOTHING = {"window_s": 2.1, "order": 2}
ROADSIDE = {"x": -25, "y": 13, "yaw_deg": 0}


def truths(folder: Path = Path(), **options: Any) -> list[Truth]:
    config = TrafficTruth.model_validate(options)
    return [traffic.load_traffic(scene, folder)[0] for scene in config.scenes()]


def refusal(folder: Path = Path(), **options: Any) -> str:
    with pytest.raises((InputError, ValidationError)) as caught:
        truths(folder, **options)
    return str(caught.value)


def write_tracks(file: Path, tracks: dict[str, tuple[np.ndarray, np.ndarray]], dt: float = 0.1) -> Path:
    rows = [
        f"{name},{dt * k!r},{float(x[k])!r},{float(y[k])!r}" for name, (x, y) in tracks.items() for k in range(len(x))
    ]
    file.write_text("\n".join(["id,time,x,y", *rows]) + "\n", encoding="utf-8")
    return file


def test_any_vehicle_is_the_observer(tmp_path: Path) -> None:
    file = write_csv(tmp_path)
    (truth,) = truths(format="csv", path=str(file), observer={"vehicle": "2"})
    assert truth.ids == ("1",)
    x, y, heading, speed, length, width = CARS["2"]
    observer = truth.observer
    np.testing.assert_allclose(truth.time, TIME, atol=1e-9)
    np.testing.assert_allclose(observer.px, x, atol=1e-9)
    np.testing.assert_allclose(observer.py, y, atol=1e-9)
    np.testing.assert_allclose(observer.yaw, heading, atol=1e-9)
    np.testing.assert_allclose(np.hypot(observer.vx, observer.vy), speed, atol=1e-9)
    assert (observer.length, observer.width) == (length, width)
    assert (truth.length.tolist(), truth.width.tolist()) == ([4.5], [1.8])


def test_a_scene_lasts_as_long_as_its_observer(tmp_path: Path) -> None:
    there = np.arange(60) * 1.0
    file = write_tracks(tmp_path / "a.csv", {"a": (there, 0 * there), "b": (there[:31] + 20, 4 + 0 * there[:31])})
    for vehicle, last in (("a", 5.9), ("b", 3.0)):
        (truth,) = truths(format="csv", path=str(file), observer={"vehicle": vehicle})
        assert truth.time[-1] == pytest.approx(last)
    (truth,) = truths(format="csv", path=str(file), observer={"vehicle": "a"}, from_s=1, duration_s=3)
    assert truth.time[-1] == pytest.approx(3)
    assert truth.px[0, 0, 0] == pytest.approx(30)
    assert truth.alive[:, 0].sum() == 21


def test_scenes_may_have_no_vehicle_in_common(tmp_path: Path) -> None:
    steps = np.arange(40) * 1.0
    cars = {f"{block}{i}": (steps + 1000 * block + 20 * i, 0 * steps) for block in range(6) for i in range(3)}
    file = write_tracks(tmp_path / "a.csv", cars)
    options = {"format": "csv", "path": str(file), "targets": {"nearest": 2}}
    assert len(truths(observer={"vehicle": [f"{block}1" for block in range(6)]}, **options)) == 6
    message = refusal(observer={"vehicle": ["01", "11", "12"]}, **options)
    assert "12 and 11 have 3 vehicles in common, such as 10, so that their scenes are one" in message
    assert "truth.observer.vehicle.2" in message


def test_smoothing_keeps_a_parabola_to_its_ends() -> None:
    at = np.arange(101) * 0.1
    for order in (2, 3, 4):
        position, velocity = smoothed(3.0 - 2.0 * at + 0.4 * at**2, 0.1, Smoothing(window_s=2.1, order=order))
        np.testing.assert_allclose(velocity, -2.0 + 0.8 * at, atol=1e-9)
        np.testing.assert_allclose(position, 3.0 - 2.0 * at + 0.4 * at**2, atol=1e-9)


def test_the_smoothed_position_is_a_mean_weighted_by_a_parabola() -> None:
    """A textbook kernel (Epanechnikov's) away from the ends, up to a constant of all steps."""
    values = np.random.default_rng(1).standard_normal(200)
    position, velocity = smoothed(values, 0.1, Smoothing(window_s=2.1, order=2))
    k = np.arange(-10, 11)
    slope = values[90:111] @ k / (k @ k) / 0.1
    assert velocity[100] == pytest.approx(slope)
    # The integral by the trapezoid of slopes: weights of half a sum of neighbours of the kernel.
    kernel = np.convolve(np.cumsum(-k[::-1] / (k @ k)), [0.5, 0.5])
    expected = np.convolve(values, kernel / kernel.sum(), mode="same")
    inside = slice(30, 170)
    offset = position[inside] - expected[inside]
    np.testing.assert_allclose(offset, offset.mean(), atol=1e-9)


def test_velocity_and_position_agree_after_smoothing(tmp_path: Path) -> None:
    noise = np.random.default_rng(2).standard_normal((2, 120)) * 0.1
    steps = np.arange(120) * 1.0
    file = write_tracks(tmp_path / "a.csv", {"a": (steps + noise[0], noise[1])})
    (truth,) = truths(format="csv", path=str(file), observer=ROADSIDE, smoothing=SMOOTHING)
    vx = truth.vx[:, 0, 0]
    np.testing.assert_allclose(np.diff(truth.px[:, 0, 0]), (vx[1:] + vx[:-1]) / 2 * 0.1, atol=1e-12)
    assert truth.audit["velocity_error_after"]["max_mps"] < 1e-9


def test_what_smoothing_takes_is_the_noise_of_the_reference(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).standard_normal((2, 2000)) * 0.2
    steps = np.arange(2000) * 1.0
    file = write_tracks(tmp_path / "a.csv", {"a": (steps + noise[0], noise[1])})
    (truth,) = truths(format="csv", path=str(file), observer=ROADSIDE, smoothing=SMOOTHING)
    assert truth.recorded_noise.position_m == pytest.approx(0.2, rel=0.1)
    assert truth.source["recorded_noise"]["position_m"] == truth.recorded_noise.position_m


def jerky(folder: Path, jump: float, acceleration: float) -> str:
    """A car that jumps by some metres at 3 s and brakes hard from 6 to 7 s."""
    at = np.arange(100) * 0.1
    speed = 20 - acceleration * np.clip(at - 6, 0, 1)
    x = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.1)]) + np.where(at > 3, jump, 0)
    return str(write_tracks(folder / "a.csv", {"a": (x, 0 * at)}))


def test_what_no_vehicle_does_is_refused_with_the_figure(tmp_path: Path) -> None:
    options: dict[str, Any] = {"format": "csv", "observer": ROADSIDE}
    path = jerky(tmp_path, 0, 18)
    message = refusal(path=path, **options)
    assert "a accelerates by 18 m/s^2 at 6." in message
    assert "(1 of 1 vehicle by more than 9)" in message
    assert "smoothing: {window_s: 2.1, order: 2}" in message
    assert "audit: repair takes the recording as it is" in message
    # Smoothed over a short time it still is.
    assert "a accelerates by" in refusal(path=path, smoothing={"window_s": 0.5}, **options)
    assert truths(path=path, audit="repair", **options)[0].audit["velocity_jumps"]["peak_acceleration_mps2"] > 17
    truths(path=jerky(tmp_path, 0, 3), **options)


def test_velocities_of_noisy_positions_are_refused_with_a_smoothing_that_makes_them_consistent(tmp_path: Path) -> None:
    noise = np.random.default_rng(2).standard_normal((2, 120)) * 0.01
    path = str(write_tracks(tmp_path / "a.csv", {"a": (np.arange(120) * 1.0 + noise[0], noise[1])}))
    options: dict[str, Any] = {"format": "csv", "observer": ROADSIDE, "path": path}
    message = refusal(**options)
    assert "the velocity contradicts the motion" in message
    assert "smoothing: {window_s: 2.1, order: 2}" in message
    truths(smoothing=SMOOTHING, **options)


@pytest.mark.parametrize(("heading", "refused"), [(0.1, False), (np.pi / 2, True), (np.pi, True)])
def test_a_heading_that_is_not_the_way_it_drives_is_refused(tmp_path: Path, heading: float, refused: bool) -> None:
    at = np.arange(40)
    rows = pd.DataFrame({"time": at * 0.1, "id": "a", "x": at * 1.0, "y": 0.0, "heading": heading})
    rows.to_csv(tmp_path / "a.csv", index=False)
    options: dict[str, Any] = {"format": "csv", "observer": ROADSIDE, "path": str(tmp_path / "a.csv")}
    if refused:
        assert f"the heading of a is {np.degrees(heading):.0f}° off the way it drives" in refusal(**options)
        truths(audit="repair", **options)
    else:
        truths(**options)


def test_who_is_parked_has_no_heading_from_noise(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(0, 0.02, (2, 80))
    file = write_tracks(tmp_path / "a.csv", {name: (x + noise[0], 3.2 + noise[1]) for name, x in (("a", 7), ("b", 37))})
    (truth,) = truths(format="csv", path=str(file), observer={"vehicle": "a"}, smoothing=SMOOTHING)
    assert not truth.observer.yaw.any()


@pytest.mark.parametrize("smoothing", [None, SMOOTHING])
def test_speeds_in_another_unit_are_refused(tmp_path: Path, smoothing: dict[str, Any] | None) -> None:
    table = pd.read_csv(write_csv(tmp_path))
    table["speed"] *= 3.6
    table.to_csv(tmp_path / "kmph.csv", index=False)
    message = refusal(tmp_path, format="csv", path="kmph.csv", observer={"vehicle": "2"}, smoothing=smoothing)
    assert "speed: v:kmph" in message


def test_smoothing_hides_no_jump(tmp_path: Path) -> None:
    options: dict[str, Any] = {"format": "csv", "observer": ROADSIDE, "smoothing": SMOOTHING}
    message = refusal(path=jerky(tmp_path, 4, 0), **options)
    assert "a jumps: smoothing moves it by 1.9 m, and at most 1.5 m is noise" in message
    truths(path=jerky(tmp_path, 0.5, 0), **options)


def test_two_vehicles_in_one_place_are_refused(tmp_path: Path) -> None:
    steps = np.arange(40) * 1.0
    cars = {"a": (steps, 0 * steps), "b": (steps + 1, 0 * steps), "c": (steps, 4 + 0 * steps)}
    path = str(write_tracks(tmp_path / "a.csv", cars))
    message = refusal(format="csv", path=path, observer=ROADSIDE)
    assert "1 pair of vehicles are in one place at one time, such as a and b" in message


def test_i80_comes_with_the_package() -> None:
    scenes = truths(format="i80", observer=ROADSIDE, smoothing=SMOOTHING)
    names = [name for truth in scenes for name in truth.ids]
    assert len(names) == len(set(names)) > 5
    figures = scenes[0].source
    assert figures["recorded_motion"]["recorded_acceleration_mps2"] == pytest.approx(20.2, abs=0.1)
    assert figures["recorded_motion"]["recorded_speed_error_mps"] == pytest.approx(0.052, abs=0.002)
    assert figures["recorded_motion"]["acceleration_mps2"] < 4


def test_i80_as_recorded_is_refused() -> None:
    message = refusal(format="i80", observer=ROADSIDE)
    assert "accelerates by 20.2 m/s^2" in message
    assert "(6 of 200 vehicles by more than 9)" in message


def test_us101_is_smoothed_and_refused_without(recorded_traffic: Path) -> None:
    options = {"format": "commonroad", "path": str(recorded_traffic / "USA_US101-5_1_T-1.xml"), "observer": ROADSIDE}
    assert "m/s^2" in refusal(**options)
    (truth,) = truths(smoothing=SMOOTHING, **options)
    assert truth.recorded_noise.position_m == pytest.approx(0.099, abs=0.005)
    assert truth.source["recorded_motion"]["acceleration_mps2"] < 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"format": "i80", "path": "a.csv"}, "this recording comes with the package; remove the path"),
        ({"format": "csv"}, "missing: the file, such as recording.csv"),
        ({"format": "i80", "observer": {"vehicle": 12}}, "write the id of a vehicle as text"),
        ({"format": "i80", "observer": {"vehicle": ["1", "1"]}}, "1 is there already"),
        ({"format": "i80", "observer": "ego"}, 'write {vehicle: "12"} or {x: 0, y: 0, yaw_deg: 0}'),
        ({"format": "i80", "observer": {"vehicle": "999"}, "smoothing": SMOOTHING}, "there is no vehicle '999'"),
        ({"format": "i80", "smoothing": {"window_s": 0.2}}, "must be at least 0.3: 4 rows of the file"),
        (
            {"format": "i80", "smoothing": SMOOTHING, "from_s": 60},
            "no vehicle is there at that time: the file has 10 s",
        ),
        ({"format": "csv", "path": "a.csv", "columns": {"tme": "t"}}, "no column of traffic; did you mean 'time'?"),
    ],
)
def test_mistakes(options: dict[str, Any], message: str) -> None:
    assert message in refusal(**{"observer": ROADSIDE, **options})


def test_intervals_of_errors_carry_the_noise_of_the_reference() -> None:
    """Its mean square is added to that of the upper end and taken from that of the lower one, and moves no value."""
    exact = MetricValue(value=0.5, unit="m", ci95=(0.4, 0.6))
    carried = widen_for_reference(exact, 0.09)
    assert carried.ci95 == pytest.approx((np.sqrt(0.16 - 0.09), np.sqrt(0.36 + 0.09)))
    assert widen_for_reference(exact, 1.0).ci95 == pytest.approx((0.0, np.sqrt(1.36)))
    assert carried.value == exact.value
    none = MetricValue(value=0.5, unit="m", reason="too short")
    assert widen_for_reference(none, 0.09) == none


SCENARIO = """
name: carried
truth:
  source: recorded-traffic
  format: csv
  path: a.csv
  observer: {{x: -20, y: 2}}
  smoothing: {{window_s: 2.1}}
sensors: {{lidar: {{type: lidar, rate_hz: 10, position_sigma_m: 0.2, max_range_m: 200}}}}
sensing: {{identities: {identities}}}
trackers: {{ekf: {{filter: ekf, motion: cv, acceleration_sigma_mps2: 2{association}}}}}
monte_carlo: {{runs: {runs}}}
"""


@pytest.mark.parametrize(
    ("identities", "association", "runs"), [("known", "", 20), ("hidden", ", associate: {method: gnn}", 400)]
)
def test_the_intervals_of_a_run_do(
    identities: str, association: str, runs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    noise = np.random.default_rng(5).standard_normal((2, 60)) * 0.1
    steps = np.arange(60) * 1.0
    write_tracks(tmp_path / "a.csv", {"a": (steps + noise[0], noise[1])})
    scenario = tmp_path / "scenario.yaml"
    text = SCENARIO.format(identities=identities, association=association, runs=runs)
    scenario.write_text(text, encoding="utf-8")
    carried = tb.run(scenario)
    monkeypatch.setattr(Work, "recorded_noise", EXACT)
    exact = tb.run(scenario)
    of_recording = carried.summary.truth.model_extra["recorded_noise"]  # type: ignore[index]
    for path, sigma in (("position_rmse", "position_m"), ("velocity_rmse", "velocity_mps")):
        value, before = carried["ekf"].metrics[path], exact["ekf"].metrics[path]
        assert value.value == before.value
        if path == "velocity_rmse" and identities == "hidden":
            assert value.ci95 is None  # As without a recording.
            continue
        assert value.ci95[1] ** 2 - before.ci95[1] ** 2 == pytest.approx(2 * of_recording[sigma] ** 2)
    assert 0.08 < of_recording["position_m"] < 0.12
    # Where a track is matched, the squared distance has that of the reference along two axes.
    for path in ("gospa_localisation", "gospa", "tgospa") if identities == "hidden" else ():
        value, before = carried["ekf"].metrics[path], exact["ekf"].metrics[path]
        assert value.value == before.value
        # There is one object, at every instant.
        matched = carried["ekf"].metrics["matched_share"].value
        assert 0.5 < matched < 1
        added = 2 * of_recording["position_m"] ** 2 * matched
        assert value.ci95[1] ** 2 - before.ci95[1] ** 2 == pytest.approx(added)
        assert value.ci95[0] ** 2 == pytest.approx(max(before.ci95[0] ** 2 - added, 0))
    for path in ("gospa_missed", "hota", "gospa_switch") if identities == "hidden" else ():
        assert carried["ekf"].metrics[path] == exact["ekf"].metrics[path]


@pytest.mark.parametrize("action", [truths_of, check])
def test_a_sensor_is_no_faster_than_the_recording(action: Callable[[tb.Scenario], object]) -> None:
    with pytest.raises(InputError, match=r"20 Hz is more than the truth has, which is recorded at 10 Hz; use 10"):
        action(load_scenario("recorded/i80", ["sensors.front_radar.rate_hz=20"]))
