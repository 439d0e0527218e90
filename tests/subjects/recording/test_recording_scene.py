"""What the scene of a recording shows and where: vehicles, trails, labels, the legend and the axes of the plots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests.support.results import with_tables

from trackbench.base.types import Array
from trackbench.document.palette import ERROR_COLOURS
from trackbench.document.replay import Chart, ChartLine
from trackbench.results import Result
from trackbench.results.columns import Columns
from trackbench.subjects.recording.contents import contents_of
from trackbench.subjects.recording.focus import moment_of
from trackbench.subjects.recording.layout import entries, left_out, legend_view
from trackbench.subjects.recording.scene import GAP, HEIGHT, LETTER, label_points
from trackbench.subjects.recording.series import charts_of
from trackbench.subjects.recording.stream import ellipse


def test_there_is_one_timeline_in_simulated_seconds(read: Any) -> None:
    assert read.timelines == {"sim_time"}
    assert set(read("/world/vehicles/v1", "Boxes2D:half_sizes")) == {round(0.05 * i, 9) for i in range(401)}


def test_each_vehicle_is_an_oriented_box_at_every_step_of_its_life(read: Any, result: Result) -> None:
    truth = result.tables.truth.to_pylist()
    for name in ("ego", *result.summary.truth.objects):
        rows = [row for row in truth if row["object"] == name]
        boxes = read(f"/world/vehicles/{name}", "Boxes2D:half_sizes")
        assert len(boxes) == 401
        assert [len(boxes[round(row["time_s"], 9)]) for row in rows] == [int(row["alive"]) for row in rows]
    row = next(row for row in truth if row["object"] == "v1" and round(row["time_s"], 9) == 8.0)
    assert read("/world/vehicles/v1", "Boxes2D:half_sizes")[8.0] == [[2.5, 1.0]]
    assert read("/world/vehicles/v1", "Transform3D:translation")[8.0][0] == pytest.approx([row["px_m"], row["py_m"], 0])
    (quaternion,) = read("/world/vehicles/v1", "Transform3D:quaternion")[8.0]
    assert 2 * np.arctan2(quaternion[2], quaternion[3]) == pytest.approx(row["heading_rad"], abs=1e-6)


def test_a_view_follows_the_observer_and_is_not_mirrored(read: Any, result: Result) -> None:
    truth = result.tables.truth.to_pylist()
    v1 = next(row for row in truth if row["object"] == "v1" and round(row["time_s"], 9) == 8.0)
    (origin,) = read("/world/frames/ego", "Transform3D:translation")[8.0]
    (flat,) = read("/world/frames/ego", "Transform3D:mat3x3")[8.0]
    to_view = np.linalg.inv(np.array(flat).reshape(3, 3, order="F"))
    seen = to_view @ (np.array([v1["px_m"], v1["py_m"] + 1.0, 0.0]) - origin)
    assert seen[0] > 0, "what is ahead of the observer is on the right"
    assert seen[1] == pytest.approx(-(v1["py_m"] + 1.0 - 4.0), abs=1e-4), "y of a 2D view points down"


def test_measurements_are_where_the_sensor_put_them_and_misses_are_not_drawn(read: Any, result: Result) -> None:
    for sensor in result.summary.sensors:
        rows = [row for row in result.tables.measurements.to_pylist() if row["sensor"] == sensor]
        drawn = {t: points for t, points in read(f"/world/measurements/{sensor}", "Points2D:positions").items() if t}
        assert sum(map(len, drawn.values())) == sum(row["valid"] for row in rows if row["time_s"])
        at_8 = [[row["x_m"], row["y_m"]] for row in rows if row["valid"] and round(row["time_s"], 9) == 8.0]
        np.testing.assert_allclose(sorted(drawn[8.0]), sorted(at_8), rtol=1e-6)


def test_an_ellipse_encloses_95_percent() -> None:
    covariance = np.array([[2.0, 0.9], [0.9, 1.0]])
    (half,), (angle,) = ellipse(*(np.array([covariance[i]]) for i in ((0, 0), (0, 1), (1, 1))))
    rng = np.random.default_rng(0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    x, y = turn @ np.linalg.cholesky(covariance) @ rng.standard_normal((2, 200_000))
    assert np.mean((x / half[0]) ** 2 + (y / half[1]) ** 2 < 1) == pytest.approx(0.95, abs=0.002)
    assert np.corrcoef(x, y)[0, 1] == pytest.approx(0, abs=0.01)


def test_a_known_covariance_is_drawn_with_its_axes_and_rotation(read: Any, result: Result) -> None:
    row = next(
        row
        for row in result.tables.estimates.to_pylist()
        if (row["tracker"], row["object"], round(row["time_s"], 9)) == ("ekf_cv", "v1", 8.0)
    )
    variances, axes = np.linalg.eigh([[row["p_00"], row["p_01"]], [row["p_01"], row["p_11"]]])
    entity = "/world/estimates/ekf_cv/v1"
    assert read(entity, "Points2D:positions")[8.0][0] == pytest.approx([row["px_m"], row["py_m"]])
    (half,) = read(f"{entity}/covariance", "Ellipses2D:half_sizes")[8.0]
    assert half == pytest.approx(2.4477 * np.sqrt(variances[::-1]), rel=1e-4)
    (quaternion,) = read(f"{entity}/covariance", "Transform3D:quaternion")[8.0]
    angle = 2 * np.arctan2(quaternion[2], quaternion[3])
    assert abs(axes[:, 1] @ [np.cos(angle), np.sin(angle)]) == pytest.approx(1.0, abs=1e-6)


def test_an_estimate_disappears_with_its_vehicle(read: Any) -> None:
    for component, entity in (("Points2D:positions", ""), ("Ellipses2D:half_sizes", "/covariance")):
        drawn = read(f"/world/estimates/ekf_cv/v5{entity}", component)
        assert (len(drawn[11.95]), len(drawn[12.0])) == (1, 0)
        assert max(t for t in drawn if t is not None) == 12.0


def test_an_estimate_that_is_not_renewed_disappears(short: Result, rewritten: Callable[..., Any]) -> None:
    estimates = short.tables.estimates
    read = rewritten(estimates=estimates.filter(pc.less(estimates["time_s"], 2.01)))
    drawn = read("/world/estimates/ekf_cv/v1", "Points2D:positions")
    assert (len(drawn[2.0]), len(drawn[2.1])) == (1, 0), "held for a period of the slowest sensor, 0.1 s"


TIME = np.arange(100) * 0.05


def chart(values: Array, **rest: Any) -> Chart:
    return Chart(("run", "error"), "Position error", "m", (ChartLine(("a",), "a", "#E69F00", TIME, values),), **rest)


def vehicle(px: float, py: float) -> Columns:
    full = np.full(3, 1.0)
    return {
        "px_m": px * full, "py_m": py * full, "length_m": 5 * full, "width_m": 2 * full, "alive": full > 0,
        "time_s": np.arange(3.0),
    }  # fmt: skip


def test_a_trail_is_the_path_piece_by_piece(read: Any, result: Result) -> None:
    rows = [row for row in result.tables.estimates.to_pylist() if row["tracker"] == "ekf_cv"]
    pieces = read("/world/trails/estimates/ekf_cv", "LineStrips2D:strips")
    now, before = (
        {row["object"]: (row["px_m"], row["py_m"]) for row in rows if round(row["time_s"], 9) == t} for t in (8.0, 7.95)
    )
    expected = sorted([list(before[name]), list(now[name])] for name in now)
    np.testing.assert_allclose(sorted(pieces[8.0]), expected, rtol=1e-6)
    true = read("/world/trails/truth", "LineStrips2D:strips")
    assert len(true[8.0]) == 6
    assert len(true[12.5]) == 5, "v5 has left at 12 s"
    assert len(true[5.0]) == 5, "v4 arrives at 5 s, and has no path before"


def test_what_spans_a_large_range_is_there_as_logarithms_too() -> None:
    steady, steep = chart(np.linspace(1, 2, 100)), chart(np.geomspace(0.01, 10, 100))
    assert (steady.large, steep.large) == (False, True)
    assert steep.log_title == "log10 of position error, m"
    assert not chart(np.geomspace(0.01, 10, 100), signed=True).large


def test_an_axis_shows_what_it_must() -> None:
    values = np.where(TIME[50] == TIME, 30.0, 1.0)
    assert chart(values).span()[1] < 2, "one peak does not flatten the rest"
    assert chart(values).span(shown=30.0)[1] > 30
    low, high = chart(np.sin(TIME), signed=True).span()
    assert -low == high > 1


def test_a_line_apart_does_not_stretch_the_axis_of_the_others() -> None:
    steady, coarse = chart(np.linspace(1, 2, 100)), chart(np.linspace(40, 60, 100))
    both = replace(steady, lines=(*steady.lines, coarse.lines[0]._replace(name="raw")))
    assert (both.large, replace(both, apart={"raw"}).large) == (True, False)
    assert replace(both, apart={"raw"}).span() == steady.span()


def test_the_ranking_says_which_plots_leave_a_tracker_out() -> None:
    near, far = chart(np.ones(100)), ChartLine(("b",), "b", "#000000", TIME[:2], np.full(2, 1e6))
    both = replace(near, lines=(*near.lines, far))
    assert left_out([near]) == ""
    assert left_out([both, both]) == "Left out of plots: b (Position error, m)."
    assert left_out([replace(both, apart=["b"])]) == "Left out of plots: b (in tabs of its own)."


def test_a_baseline_is_apart_from_the_contenders(result: Result) -> None:
    flagged = [item.model_copy(update={"baseline": item.name == "raw"}) for item in result.summary.trackers]
    charts = charts_of(contents_of(result.updated(trackers=flagged)))
    for own in (charts.all_runs, charts.recorded, charts.vehicles["v1"]):
        assert [line.name for line in own.errors[0].others] == ["raw"]
    alone = [item for item in flagged if item.baseline]
    assert not contents_of(result.updated(trackers=alone, ranking=["raw"])).baselines


def test_the_map_has_the_true_paths_in_the_colours_of_the_errors(read: Any, result: Result) -> None:
    strips, colours = (read("/errors/ekf_cv", f"LineStrips2D:{part}")[None] for part in ("strips", "colors"))
    rows = [row for row in result.tables.estimates.to_pylist() if row["tracker"] == "ekf_cv"]
    errors = {name: [row["position_error_m"] for row in rows if row["object"] == name] for name in ("v1", "v2")}
    assert len(strips) == len(rows) - len(result.summary.truth.objects)
    large = int(ERROR_COLOURS[2][1:] + "FF", 16)
    pieces = [max(pair) for own in errors.values() for pair in pairwise(own)]
    assert sum(colour == large for colour in colours) >= sum(error > 1.0 for error in pieces) > 0


def test_plots_go_on_for_so_long_that_the_last_label_has_room(read: Any, result: Result) -> None:
    rmse = read("/series/all_runs/position_rmse/ekf_cv", "Scalars:scalars")
    last = max(rmse)
    assert (last, rmse[last]) == (pytest.approx(1.05 * result.tables.steps["time_s"].to_numpy().max()), [])


def test_a_recording_opens_where_contenders_differ_most(result: Result) -> None:
    rows = result.tables.estimates.to_pylist()
    for row in rows:
        if (row["tracker"], row["object"]) == ("ekf_cv", "v2") and 8.0 <= row["time_s"] <= 9.0:
            row["px_m"], row["position_error_m"] = row["px_m"] + 9.0, 9.0
    apart = with_tables(result, estimates=pa.Table.from_pylist(rows))
    moment = moment_of(apart)
    assert moment.vehicle == "v2"
    assert moment.time_s == pytest.approx(8.5, abs=0.4)


def test_logarithms_are_of_the_values(read: Any) -> None:
    plain = read("/series/vehicles/v1/position_error/raw", "Scalars:scalars")
    logarithms = read("/series/log10/vehicles/v1/position_error/raw", "Scalars:scalars")
    for time in (1.0, 8.0, 19.0):
        assert logarithms[time] == [np.log10(plain[time][0])]


def test_the_plots_of_a_vehicle_are_of_it_alone(read: Any, result: Result) -> None:
    rows = result.tables.estimates.to_pylist()
    row = next(r for r in rows if (r["tracker"], r["object"], round(r["time_s"], 9)) == ("ekf_cv", "v2", 8.0))
    for name, column in (
        ("position_error", "position_error_m"),
        ("velocity_error", "velocity_error_mps"),
        ("nees", "nees"),
    ):
        assert np.isclose(read(f"/series/vehicles/v2/{name}/ekf_cv", "Scalars:scalars")[8.0], row[column])


def test_names_of_vehicles_do_not_overlap() -> None:
    # Three lanes of 4 m, three cars side by side and one close behind, at a scale where names are wider than cars.
    cars = [vehicle(0, 0), vehicle(0, 4), vehicle(0, 8), vehicle(-7, 0)]
    names, scale = ["v1", "v2", "v3", "observer"], 0.18
    points = label_points(cars, names, scale)
    boxes = []
    for point, name in zip(points, names, strict=True):
        half = LETTER * len(name) / 2 * scale
        top = point[0, 1] - GAP * scale
        boxes.append((point[0, 0] - half, point[0, 0] + half, top - HEIGHT * scale, top))
    for a, b in combinations(boxes, 2):
        assert a[1] <= b[0] or b[1] <= a[0] or a[3] <= b[2] + 1e-9 or b[3] <= a[2] + 1e-9


def test_the_legend_names_every_colour_once(read: Any, result: Result) -> None:
    names = [name for entity in read.entities() if entity.startswith("/legend/") for name in labels(read, entity)]
    assert sorted(names) == sorted(
        [
            *(t.name for t in result.scored),
            *("front_radar", "roof_lidar", "truth, bounds", "observer"),
            *("error < 0.5 m", "0.5 to 1 m", "above 1 m"),
        ]
    )
    assert legend_view(entries({"a": "#E69F00"}, ["radar"])).name == "Legend"


def labels(read: Any, entity: str) -> list[str]:
    kinds = [f"{kind}:labels" for kind in ("LineStrips2D", "Points2D")]
    return [name for kind in kinds if (entity, kind) in read.parts for name in read(entity, kind)[None]]
