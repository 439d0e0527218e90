"""Errors at a stated point of each body: a car of known length and yaw, and trackers that report a known point."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.base.types import Observer, Truth
from trackbench.sensing.scored_point import truth_of_point

LENGTH, WIDTH, YAW = 4.0, 1.6, 110.0
CENTRE = np.array([20.0, 5.0])
AXIS = np.array([math.cos(math.radians(YAW)), math.sin(math.radians(YAW))])
REAR = CENTRE - LENGTH / 2 * AXIS

#: Reports a standing car at the point of its options, whatever is measured.
POINTS = """
import numpy as np
class Point:
    def __init__(self, x, y): self.mean = np.array([x, y, 0.0, 0.0])
    def step(self, state, scan): return 1, (self.mean, np.eye(4))
class Points(Point):
    def step(self, state, scan): return 1, (np.zeros(1, dtype=int), self.mean[:, None], np.eye(4)[:, :, None])
"""


def scenario(hidden: bool, point: str, folder: Path, **changes: Any) -> Path:
    """The file of a standing car, and of a tracker that reports the middle of its rear."""
    (folder / "points.py").write_text(POINTS, encoding="utf-8")
    x, y = map(float, REAR)
    use = f"points:{'Points' if hidden else 'Point'}"
    content = {
        "name": "standing",
        "truth": {
            "source": "scripted",
            "duration_s": 2,
            "rate_hz": 10,
            "objects": {
                "car": {
                    "start": {"x": 20, "y": 5, "course_deg": YAW, "speed_mps": 0},
                    "length_m": LENGTH,
                    "width_m": WIDTH,
                }
            },
        },
        "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.1}},
        "sensing": {"identities": "hidden" if hidden else "known"},
        "trackers": {"at_rear": {"use": use, "options": {"x": x, "y": y}}},
        "monte_carlo": {"runs": 2, "seed": 1},
        "score": {"point": point},
        **changes,
    }
    (folder / "standing.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return folder / "standing.yaml"


def to_face() -> float:
    """Distance from the rear's middle to that of the face nearest to the origin, by hand: of four candidates."""
    across = np.array([-AXIS[1], AXIS[0]])
    faces = [CENTRE + s * LENGTH / 2 * AXIS for s in (1, -1)] + [CENTRE + s * WIDTH / 2 * across for s in (1, -1)]
    return float(np.linalg.norm(min(faces, key=lambda face: float(np.hypot(*face))) - REAR))


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize(("point", "error"), [("rear", 0.0), ("centre", LENGTH / 2), ("nearest_face", to_face())])
def test_the_error_of_a_tracker_that_reports_the_rear_is_the_distance_to_the_point(
    tmp_path: Path, hidden: bool, point: str, error: float
) -> None:
    result = tb.run(tb.load(scenario(hidden, point, tmp_path)))
    metrics = result["at_rear"].metrics
    path = "position_rmse" if "position_rmse" in metrics else "matched_position_rmse"
    assert metrics[path].value == pytest.approx(error, abs=1e-9)
    assert ("each body" in result.summary.scenario.description) == (point != "centre")


def test_the_gate_of_hidden_identities_is_at_the_point(tmp_path: Path) -> None:
    """With a cutoff of 1.5 m a track 2 m from its object is on none."""
    missed = {}
    for point in ("rear", "centre"):
        loaded = tb.load(scenario(True, point, tmp_path), {"score.cutoff_m": 1.5})
        missed[point] = tb.run(loaded)["at_rear"].metrics["gospa_missed"].value
    assert missed["rear"] == pytest.approx(0.0)
    assert missed["centre"] > 0


def turning(x: float, heading: float, yaw_rate: float, **sizes: Any) -> Truth:
    """A car at one instant, seen from the origin."""
    one = np.ones((1, 1, 1))
    observer = Observer(*np.zeros((6, 1)))
    body = {"length": np.array([LENGTH]), "width": np.array([WIDTH])} | sizes
    return Truth(
        time=np.zeros(1), ids=("car",), px=x * one, py=0 * one, heading=heading * one, course=heading * one,
        speed=10 * one, acceleration=0 * one, yaw_rate=yaw_rate * one, alive=np.ones((1, 1), dtype=bool),
        observer=observer, **body,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("heading", "face"),
    [(0.0, (-2.0, 0.0)), (math.pi, (-2.0, 0.0)), (math.pi / 2, (-0.8, 0.0)), (-math.pi / 2, (-0.8, 0.0))],
)
def test_the_nearest_face_is_that_towards_the_observer(heading: float, face: tuple[float, float]) -> None:
    state = truth_of_point(turning(20.0, heading, 0.0), "nearest_face").state[:2, 0, 0, 0]
    assert state - [20.0, 0.0] == pytest.approx(face, abs=1e-9)


def test_the_velocity_is_that_of_the_body_at_the_point() -> None:
    """The rear of a car that turns left moves to the right: by half the length times the yaw rate."""
    truth = turning(20.0, 0.0, 0.5)
    assert truth_of_point(truth, "rear").state[:, 0, 0, 0] == pytest.approx([18.0, 0.0, 10.0, -1.0])
    # A finite difference of the rear's place, of a car that turns about its moving centre.
    dt, heading = 1e-6, 0.5e-6
    later = np.array([20 + 10 * dt, 0]) - 2 * np.array([math.cos(heading), math.sin(heading)])
    assert (later - [18.0, 0.0]) / dt == pytest.approx([10.0, -1.0], abs=1e-5)


def test_of_a_body_without_a_size_only_the_centre_is_scored() -> None:
    unknown = turning(20.0, 0.0, 0.0, length=np.zeros(1))
    assert truth_of_point(unknown, "centre") is unknown
    with pytest.raises(InputError, match="the size of car is not known"):
        truth_of_point(unknown, "rear")


def test_the_errors_name_line_and_key(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"standing.yaml:\d+: score.point.*rear"):
        tb.load(scenario(False, "read", tmp_path))
    functions = {"fcw": {"use": "forward_collision_warning", "ttc_s": 2.4}}
    file = scenario(False, "rear", tmp_path, functions=functions)
    with pytest.raises(InputError, match=r"standing.yaml:\d+: score.point: functions reckon from the centre"):
        tb.load(file, {"truth.observer": {"start": {"speed_mps": 20}}})


def test_no_bound_is_compared_with_at_another_point(tmp_path: Path) -> None:
    result = tb.run(tb.load(scenario(False, "rear", tmp_path)))
    assert result["at_rear"].metrics["position_over_reference"].value is None
    assert "no bound there" in str(result.report())
