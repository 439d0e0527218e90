"""From raw frames to a truth, and lanes to polylines."""

import numpy as np
import pytest

from trackbench.base.types import Array, Observer
from trackbench.truth.frames import Frames, lane_edges

DT = 0.1
STEPS = 20


def bicycle(speed: float, steering: float, absent: slice = slice(0, 0)) -> Frames:
    """The kinematic bicycle of highway-env, integrated by Euler's rule."""
    slip = np.full(STEPS, np.arctan(0.5 * np.tan(steering)))
    heading = 0.3 + np.arange(STEPS) * DT * speed * np.sin(slip) / 2.5
    px, py = (np.concatenate([[0.0], np.cumsum(speed * f(heading + slip) * DT)[:-1]]) for f in (np.cos, np.sin))
    columns = {"px": px, "py": py, "heading": heading, "slip": slip, "speed": np.full(STEPS, speed)}
    columns = {name: values[:, None].copy() for name, values in columns.items()}
    for values in columns.values():
        values[absent] = np.nan
    one = np.ones(1)
    never = np.zeros((STEPS, 1), dtype=bool)
    return Frames(DT, ("v1",), **columns, collided=never, length=one, width=one)


def roadside() -> Observer:
    zero = np.zeros(STEPS)
    return Observer(zero, zero, zero, zero, zero, zero)


@pytest.mark.parametrize("speed", [8.0, -3.0])
def test_course_points_along_the_motion(speed: float) -> None:
    truth = bicycle(speed, steering=0.4).truth([0], roadside())
    assert (truth.speed >= 0.0).all()
    np.testing.assert_allclose(truth.vx[:-1], np.diff(truth.px, axis=0) / DT, atol=1e-12)
    np.testing.assert_allclose(truth.vy[:-1], np.diff(truth.py, axis=0) / DT, atol=1e-12)
    np.testing.assert_allclose(truth.yaw_rate, speed * np.sin(np.arctan(0.5 * np.tan(0.4))) / 2.5)
    assert (np.abs(truth.course) <= np.pi).all()


def test_heading_is_where_the_body_points_even_in_reverse() -> None:
    truth = bicycle(-3.0, steering=0.0).truth([0], roadside())
    np.testing.assert_allclose(truth.heading, 0.3)
    np.testing.assert_allclose(truth.course, 0.3 - np.pi)


def test_carrier_moves_as_its_body() -> None:
    frames = bicycle(8.0, steering=0.4)
    carrier, truth = frames.carrier(0), frames.truth([0], roadside())
    np.testing.assert_allclose(carrier.vx, truth.vx[:, 0, 0])
    np.testing.assert_allclose(carrier.yaw, truth.heading[:, 0, 0])
    np.testing.assert_allclose(carrier.yaw_rate, truth.yaw_rate[:, 0, 0])


class Straight:
    """A lane along x."""

    def __init__(self, y: float, length: float, line_types: list[int] | None) -> None:
        self.y, self.length, self.line_types = y, length, line_types

    def position(self, longitudinal: float, lateral: float) -> Array:
        return np.array([longitudinal, self.y + lateral])

    def width_at(self, longitudinal: float) -> float:
        return 4.0


def test_lane_edges_are_clipped_simplified_and_drawn_once() -> None:
    lanes = [Straight(0.0, 10_000.0, [2, 1]), Straight(4.0, 10_000.0, [1, 0])]
    edges = lane_edges(lanes, np.array([200.0, 300.0]), np.zeros(2))
    np.testing.assert_allclose(edges, [[[100, 2], [400, 2]], [[100, -2], [400, -2]]])
