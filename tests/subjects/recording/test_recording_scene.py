"""What the scene of a recording shows and where: vehicles, measurements, estimates and their covariances."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests.support.results import with_tables

from trackbench.results import Result
from trackbench.subjects.recording.focus import moment_of
from trackbench.subjects.recording.stream import outlines


def test_there_is_one_timeline_in_simulated_seconds(read: Any) -> None:
    assert read.timelines == {"sim_time"}
    assert set(read("/world/vehicles/v1", "Boxes2D:half_sizes")) == {round(0.05 * i, 9) for i in range(401)}


def test_each_vehicle_is_an_oriented_box_at_every_step_of_its_life(read: Any, result: Result) -> None:
    truth = result.tables.truth.to_pylist()
    for name in ("observer", *result.summary.truth.objects):
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
    (origin,) = read("/world/frames/observer", "Transform3D:translation")[8.0]
    (flat,) = read("/world/frames/observer", "Transform3D:mat3x3")[8.0]
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
    (line,) = outlines(np.array([[3.0, -1.0]]), *(np.array([covariance[i]]) for i in ((0, 0), (0, 1), (1, 1))))
    away = np.asarray(line, dtype=float) - (3.0, -1.0)
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", away, np.linalg.inv(covariance), away), 5.991, rtol=1e-4)
    assert np.ptp(away[:, 0]) == pytest.approx(2 * np.sqrt(5.991 * 2.0), rel=0.02), "it goes all the way round"


def test_an_estimate_disappears_with_its_vehicle(read: Any) -> None:
    for component, entity in (("Points2D:positions", "tracks"), ("LineStrips2D:strips", "covariances")):
        counts = read(f"/world/{entity}/ekf_cv", component)
        assert (len(counts[11.95]), len(counts[12.0])) == (5, 4)


def test_an_estimate_that_is_not_renewed_disappears(short: Result, rewritten: Callable[..., Any]) -> None:
    estimates = short.tables.estimates
    others = pc.not_equal(estimates["tracker"], "ekf_cv")
    read = rewritten(estimates=estimates.filter(pc.or_(others, pc.less(estimates["time_s"], 2.01))))
    counts = read("/world/tracks/ekf_cv", "Points2D:positions")
    assert (len(counts[2.0]), len(counts[2.05])) == (1, 0)


def test_a_recording_opens_at_the_largest_error(result: Result) -> None:
    rows = result.tables.estimates.to_pylist()
    for row in rows:
        if (row["tracker"], row["object"]) == ("ekf_cv", "v2") and 8.0 <= row["time_s"] <= 9.0:
            row["px_m"], row["position_error_m"] = row["px_m"] + 9.0, 9.0
    apart = with_tables(result, estimates=pa.Table.from_pylist(rows))
    moment = moment_of(apart)
    assert moment.vehicle == "v2"
    assert 8.0 <= moment.time_s <= 9.0
