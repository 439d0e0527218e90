"""Scripted motion: closed forms and drawn noise."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.scenes import block_of, work

from trackbench.base.errors import InputError
from trackbench.base.types import Truth
from trackbench.models.sensors import Lidar, Radar
from trackbench.sensing.scans import ideal_sensors
from trackbench.trackers.config import FilterConfig
from trackbench.truth import Draw
from trackbench.truth.sources import ScriptedTruth

WHITE = {"white": {"motion": "cv", "acceleration_sigma_mps2": 3}}


def config(objects: dict[str, Any], **keys: Any) -> ScriptedTruth:
    given = {"source": "scripted", "duration_s": 10, "rate_hz": 20, "objects": objects, **keys}
    return ScriptedTruth.model_validate(given)


def drawn(of: ScriptedTruth, runs: int = 1, seed: int = 0, scenario: str = "test") -> Truth:
    return of.load(Draw(seed, scenario, runs), folder=Path()).truth


def one(*pieces: dict[str, Any], start: dict[str, Any] | None = None, **keys: Any) -> Truth:
    """The truth of a single object."""
    return drawn(config({"a": {"start": start or {}, "pieces": list(pieces)}}, **keys))


def test_constant_velocity() -> None:
    truth = one({}, start={"x": 1, "y": -2, "vx_mps": 3, "vy_mps": -4})
    np.testing.assert_allclose(truth.time, np.arange(201) / 20)
    np.testing.assert_allclose(truth.px[:, 0, 0], 1 + 3 * truth.time, atol=1e-12)
    np.testing.assert_allclose(truth.py[:, 0, 0], -2 - 4 * truth.time, atol=1e-12)
    np.testing.assert_allclose(truth.vx, 3)
    np.testing.assert_allclose(truth.vy, -4)
    assert truth.alive.all()


def test_constant_acceleration_brakes_and_then_reverses() -> None:
    truth = one({"acceleration_mps2": -2}, start={"y": 5, "speed_mps": 6, "course_deg": 90})
    t = truth.time
    np.testing.assert_allclose(truth.py[:, 0, 0], 5 + 6 * t - t**2, atol=1e-12)
    np.testing.assert_allclose(truth.px, 0, atol=1e-12)
    np.testing.assert_allclose(truth.vy[:, 0, 0], 6 - 2 * t, atol=1e-12)
    np.testing.assert_allclose(truth.speed[:, 0, 0], np.abs(6 - 2 * t), atol=1e-12)
    np.testing.assert_allclose(truth.heading, np.pi / 2)
    np.testing.assert_allclose(np.rad2deg(truth.course[t > 3]), -90)
    np.testing.assert_allclose(truth.acceleration[t > 3], 2)


def test_constant_turn_rate_is_a_circle() -> None:
    truth = one({"turn_rate_degps": 36}, start={"speed_mps": 5})
    turn = np.deg2rad(36)
    np.testing.assert_allclose(truth.px[:, 0, 0], 5 / turn * np.sin(turn * truth.time), atol=1e-12)
    np.testing.assert_allclose(truth.py[:, 0, 0], 5 / turn * (1 - np.cos(turn * truth.time)), atol=1e-12)
    np.testing.assert_allclose(truth.vx[:, 0, 0], 5 * np.cos(turn * truth.time), atol=1e-12)
    np.testing.assert_allclose(truth.yaw_rate, turn)
    assert np.abs(truth.heading).max() <= np.pi


def test_pieces_go_on_from_each_other() -> None:
    truth = one({"for_s": 5, "turn_rate_degps": 36}, {"turn_rate_degps": -36}, start={"speed_mps": 5})
    radius = 5 / np.deg2rad(36)
    np.testing.assert_allclose([truth.px[100, 0, 0], truth.py[100, 0, 0]], [0, 2 * radius], atol=1e-12)
    np.testing.assert_allclose([truth.px[200, 0, 0], truth.py[200, 0, 0]], [0, 4 * radius], atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(truth.yaw_rate[[99, 100], 0, 0]), [36, -36])


def test_waypoints() -> None:
    pieces = [{"for_s": 1}, {"waypoints": [[10, 0], [10, 20], [10, 20], [0, 20]], "speed_mps": 5}]
    truth = one(*pieces, start={"x": -2, "speed_mps": 2})
    rows = np.searchsorted(truth.time, [0.5, 1.0, 2.0, 2.95, 3.0, 5.0, 7.0, 8.0, 10.0])
    x = [-1, 0, 5, 9.75, 10, 10, 10, 5, -5]
    y = [0, 0, 0, 0, 0, 10, 20, 20, 20]
    np.testing.assert_allclose(truth.px[rows, 0, 0], x, atol=1e-9)
    np.testing.assert_allclose(truth.py[rows, 0, 0], y, atol=1e-9)
    np.testing.assert_allclose(truth.speed[rows, 0, 0], [2, *[5] * 8])
    np.testing.assert_allclose(np.rad2deg(truth.course[rows, 0, 0]), [0, 0, 0, 0, 90, 90, 180, 180, 180], atol=1e-9)


def test_waypoints_keep_the_speed_unless_told() -> None:
    truth = one({"waypoints": [[3, 4]]}, start={"speed_mps": 1})
    np.testing.assert_allclose([truth.px[-1, 0, 0], truth.py[-1, 0, 0]], [6, 8])
    with pytest.raises(InputError, match="stands still") as caught:
        one({"waypoints": [[3, 4]]})
    assert caught.value.key == "truth.objects.a.pieces.0.speed_mps"


def test_an_object_without_motion_stands_where_it_points() -> None:
    truth = one({}, start={"x": 3, "course_deg": 90})
    assert (truth.speed == 0).all()
    np.testing.assert_allclose(truth.heading, np.pi / 2)


def test_observer_moves() -> None:
    of = config({"a": {}}, observer={"x": 1, "y": 2, "yaw_deg": 90, "vx_mps": 3, "turn_rate_degps": 45})
    observer = drawn(of).observer
    np.testing.assert_allclose([observer.px[-1], observer.py[-1]], [31, 2])
    np.testing.assert_allclose([observer.vx[-1], observer.vy[-1], observer.yaw_rate[-1]], [3, 0, np.pi / 4])
    np.testing.assert_allclose(np.rad2deg(observer.yaw[[0, 40]]), [90, 180])


def test_a_body_brakes_to_a_standstill_and_stands() -> None:
    pieces = [{"for_s": 2}, {"for_s": 6, "acceleration_mps2": -3, "until_stop": True}, {"acceleration_mps2": 1}]
    truth = one(*pieces, start={"x": 5, "speed_mps": 10})
    t = truth.time
    braking = np.minimum(np.maximum(t - 2, 0), 10 / 3)
    starting = np.maximum(t - 8, 0)
    x = 5 + 10 * (np.minimum(t, 2) + braking) - 1.5 * braking**2 + 0.5 * starting**2
    np.testing.assert_allclose(truth.px[:, 0, 0], x, atol=1e-12)
    np.testing.assert_allclose(truth.speed[:, 0, 0], 10 - 3 * braking + starting, atol=1e-12)
    stands = (t > 2 + 10 / 3) & (t < 8)
    assert (truth.speed[stands] == 0).all()
    assert (truth.acceleration[stands] == 0).all()
    np.testing.assert_array_equal(truth.course, 0)


def test_a_turn_ends_where_the_body_stops() -> None:
    truth = one({"acceleration_mps2": -2.5, "turn_rate_degps": 30, "until_stop": True}, start={"speed_mps": 5})
    stands = truth.time >= 2
    np.testing.assert_allclose(np.rad2deg(truth.heading[stands]), 60)
    assert (truth.yaw_rate[stands] == 0).all()
    np.testing.assert_allclose(np.ptp(truth.px[stands]), 0, atol=1e-12)


def driving(*pieces: dict[str, Any], start: dict[str, Any], **size: float) -> ScriptedTruth:
    """A car at (60, 5) before an ego that drives."""
    return config({"car": {"start": {"x": 60, "y": 5}}}, observer={"start": start, "pieces": list(pieces), **size})


def test_the_ego_drives_like_an_object() -> None:
    pieces = [
        {"for_s": 2, "turn_rate_degps": 15, "acceleration_mps2": 1},
        {"waypoints": [[40, 30]], "for_s": 3},
        {"acceleration_mps2": -4, "until_stop": True, "turn_rate_degps": -5},
    ]
    start = {"x": -3, "y": 2, "speed_mps": 8, "course_deg": 170}
    ego, body = drawn(driving(*pieces, start=start)).observer, one(*pieces, start=start)
    for name in ("px", "py", "vx", "vy", "yaw_rate"):
        np.testing.assert_allclose(getattr(ego, name), getattr(body, name)[:, 0, 0], rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(ego.yaw, body.heading[:, 0, 0])
    assert np.ptp(ego.yaw[-20:]) == np.hypot(ego.vx, ego.vy)[-20:].max() == 0, "it stands and keeps its heading"


def test_a_radar_on_an_ego_that_brakes_in_a_turn() -> None:
    piece = {"acceleration_mps2": -2, "turn_rate_degps": 10}
    truth = drawn(driving(piece, start={"speed_mps": 20}, length_m=5))
    mount = {"x_m": 2.5, "y_m": 0.5, "yaw_deg": 5}
    radar = Radar(rate_hz=20, mount=mount, range_sigma_m=1, azimuth_sigma_deg=1, range_rate_sigma_mps=1)
    (sensor,) = ideal_sensors(truth, {"radar": radar})
    # Speed v0 + a t along the heading w t: the integral by parts.
    t, a, w, v0 = truth.time, -2, np.deg2rad(10), 20
    v, yaw = v0 + a * t, w * t
    x = v * np.sin(yaw) / w + a * (np.cos(yaw) - 1) / w**2
    y = (v0 - v * np.cos(yaw)) / w + a * np.sin(yaw) / w**2
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = 60 - (x + 2.5 * c - 0.5 * s), 5 - (y + 2.5 * s + 0.5 * c)
    vx, vy = v * c - w * (2.5 * s + 0.5 * c), v * s + w * (2.5 * c - 0.5 * s)
    distance = np.hypot(dx, dy)
    azimuth = np.arctan2(dy, dx) - yaw - np.deg2rad(5)
    expected = [distance, np.arctan2(np.sin(azimuth), np.cos(azimuth)), -(dx * vx + dy * vy) / distance]
    np.testing.assert_allclose(sensor.measurement[:, :, 0, 0], expected, atol=1e-10)


def test_white_acceleration_has_the_stated_sigma_on_each_axis() -> None:
    piece = {"white_acceleration": {"x_sigma_mps2": 5, "y_sigma_mps2": 0}}
    truth = drawn(config({"a": {"start": {"vy_mps": 5}, "pieces": [piece]}}), runs=50)
    acceleration = np.diff(truth.vx[:, 0], axis=0) * 20
    n = acceleration.size
    # 99.9 % bounds; of the variance by the normal approximation to chi-square.
    assert abs(acceleration.mean()) < 3.3 * 5 / np.sqrt(n)
    assert abs(acceleration.var() / 25 - 1) < 3.3 * np.sqrt(2 / n)
    assert abs(np.mean(acceleration[1:] * acceleration[:-1]) / 25) < 3.3 / np.sqrt(n)
    np.testing.assert_allclose(truth.vy, 5)
    step = (truth.vx[:-1] + truth.vx[1:]) / 2 / 20
    np.testing.assert_allclose(np.diff(truth.px, axis=0), step, atol=1e-9)
    along, across = truth.acceleration, truth.speed * truth.yaw_rate
    np.testing.assert_allclose(np.hypot(along, across)[:-1, 0], np.abs(acceleration), atol=1e-8)


@pytest.mark.parametrize(
    ("noise", "speed_sigma", "turn_sigma"),
    [
        ({"motion": "cv", "acceleration_sigma_mps2": 2}, None, None),
        ({"motion": "ca", "jerk_sigma_mps3": 2}, None, None),
        ({"motion": "ctrv", "acceleration_sigma_mps2": 2, "yaw_acceleration_sigma_radps2": 0.5}, 2, 0.5),
        ({"motion": "ctra", "jerk_sigma_mps3": 2, "yaw_acceleration_sigma_radps2": 0.5}, None, 0.5),
    ],
)
def test_motion_models_drive_with_their_own_noise(
    noise: dict[str, Any], speed_sigma: float | None, turn_sigma: float | None
) -> None:
    of = config({"a": {"start": {"speed_mps": 30}, "pieces": [{"white": noise}]}}, duration_s=4)
    truth = drawn(of, runs=100)
    assert truth.px.shape == (81, 1, 100)
    tolerance = 3.3 * np.sqrt(2 / (80 * 100))
    if speed_sigma is not None:
        assert abs(np.var(np.diff(truth.speed, axis=0) * 20) / speed_sigma**2 - 1) < tolerance
    if turn_sigma is not None:
        assert abs(np.var(np.diff(truth.yaw_rate, axis=0) * 20) / turn_sigma**2 - 1) < tolerance
    if noise["motion"] == "cv":
        total = np.diff([truth.vx, truth.vy], axis=1) * 20
        assert abs(np.var(total) / 4 - 1) < tolerance
    if noise["motion"] == "ca":
        c, s = np.cos(truth.course), np.sin(truth.course)
        along, across = truth.acceleration, truth.speed * truth.yaw_rate
        jerk = np.diff([c * along - s * across, s * along + c * across], axis=1) * 20
        assert abs(np.var(jerk) / 4 - 1) < tolerance


def test_turn_rate_is_carried_into_random_motion() -> None:
    noise = {"motion": "ctrv", "acceleration_sigma_mps2": 1e-9, "yaw_acceleration_sigma_radps2": 1e-9}
    truth = one({"for_s": 2, "turn_rate_degps": 20}, {"white": noise}, start={"speed_mps": 5})
    np.testing.assert_allclose(np.rad2deg(truth.yaw_rate), 20, atol=1e-6)


def test_a_run_depends_on_nothing_but_its_number_and_what_it_is_drawn_by() -> None:
    objects = {"a": {"pieces": [WHITE]}, "b": {"pieces": [WHITE]}}
    truth = drawn(config(objects), runs=20)
    np.testing.assert_array_equal(truth.px[..., :18], drawn(config(objects), runs=18).px)
    np.testing.assert_array_equal(truth.px[:, 1], drawn(config({"b": {"pieces": [WHITE]}}), runs=20).px[:, 0])
    ends = [truth.px[-1, 0, 17], truth.px[-1, 1, 17], truth.px[-1, 0, 16]]
    ends += [drawn(config(objects), 18, seed=1).px[-1, 0, 17], drawn(config(objects), 18, scenario="b").px[-1, 0, 17]]
    assert len(set(ends)) == 5


def test_more_runs_than_fit_are_refused() -> None:
    with pytest.raises(InputError, match="at most 99502 fit") as caught:
        drawn(config({"a": {"pieces": [WHITE]}}), runs=100_000)
    assert caught.value.key == "monte_carlo.runs"
    assert drawn(config({"a": {}}), runs=100_000).px.shape == (201, 1, 1)


def test_blocks_of_runs_see_their_own_truth() -> None:
    truth = drawn(config({"a": {"pieces": [WHITE]}, "b": {}}), runs=6)
    kf = FilterConfig(filter="kf", motion="cv", acceleration_sigma_mps2=3)
    of = work(truth, {"lidar": Lidar(rate_hz=20, position_sigma_m=0.1)}, {"kf": kf}, 6)
    whole, part = block_of(of, range(6)), block_of(of, range(3, 5))
    assert part.digests == whole.digests[3:5]
    some, every = (block.outcomes["kf"].scores.per_run for block in (part, whole))
    np.testing.assert_allclose(some, every[:, 3:5], rtol=1e-9)


@pytest.mark.parametrize(
    ("pieces", "sigma"),
    [
        ([WHITE], 3),
        ([{**WHITE, "for_s": 4}, WHITE], 3),
        ([{"white_acceleration": {"x_sigma_mps2": 2, "y_sigma_mps2": 2}}], 2),
        ([{"white_acceleration": {"x_sigma_mps2": 2}}], None),
        ([{**WHITE, "for_s": 4}, {}], None),
        ([{"white": {"motion": "ca", "jerk_sigma_mps3": 3}}], None),
        ([{"turn_rate_degps": 5}], None),
        ([{"acceleration_mps2": 1}], None),
        ([{"waypoints": [[50, 0]], "speed_mps": 5}], None),
        ([{"for_s": 4}, {}], 0),
    ],
)
def test_white_acceleration_is_all_that_drives_every_object_or_none(pieces: Any, sigma: float | None) -> None:
    assert config({"a": {"pieces": pieces}}).white_acceleration == sigma
    assert config({"a": {"pieces": pieces}, "b": {"pieces": [WHITE]}}).white_acceleration == (3 if sigma == 3 else None)
