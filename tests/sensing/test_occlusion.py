"""Objects that hide each other, against a slow test of every line of sight with every side of every box."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from tests.support.scenes import truth

from trackbench.base.types import Array, Mask, Truth
from trackbench.sensing import view
from trackbench.sensing.view import crosses, occluded


def scattered(objects: int, runs: int, steps: int, seed: int) -> Truth:
    """Boxes of all sizes and headings around the origin, some of them absent."""
    random = np.random.default_rng(seed)
    shape = (steps, objects, runs)
    angle, distance = random.uniform(-np.pi, np.pi, shape), random.uniform(8, 40, shape)
    still = np.zeros(shape)
    of = truth(np.arange(steps) / 10, distance * np.cos(angle), distance * np.sin(angle), still, still)
    return replace(
        of,
        heading=random.uniform(-np.pi, np.pi, shape),
        length=random.uniform(2, 12, objects),
        width=random.uniform(1, 3, objects),
        alive=random.random((steps, objects)) < 0.8,
    )


def corners(of: Truth, k: int, i: int, run: int) -> Array:
    """``(4, 2)``."""
    c, s = np.cos(of.heading[k, i, run]), np.sin(of.heading[k, i, run])
    half = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * [of.length[i] / 2, of.width[i] / 2]
    return np.array([of.px[k, i, run], of.py[k, i, run]]) + half @ np.array([[c, s], [-s, c]])


def cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def meets(start: Array, end: Array, box: Array) -> bool:
    """Whether a segment crosses a side of a box ``(4, 2)``, or ends within it."""
    for p, q in zip(box, np.roll(box, -1, axis=0), strict=True):
        apart = cross(end - start, p - start) * cross(end - start, q - start) < 0
        if apart and cross(q - p, start - p) * cross(q - p, end - p) < 0:
            return True
    turns = [cross(q - p, end - p) for p, q in zip(box, np.roll(box, -1, axis=0), strict=True)]
    return all(turn < 0 for turn in turns) or all(turn > 0 for turn in turns)


def slow(of: Truth, origin: Array) -> Mask:
    steps, objects, runs = of.px.shape
    found = np.zeros(of.px.shape, dtype=bool)
    for k, i, run in product(range(steps), range(objects), range(runs)):
        points = [np.array([of.px[k, i, run], of.py[k, i, run]]), *corners(of, k, i, run)]
        boxes = [corners(of, k, j, run) for j in range(objects) if j != i and of.alive[k, j]]
        found[k, i, run] = all(any(meets(origin[:, k], point, box) for box in boxes) for point in points)
    return found


@pytest.mark.parametrize(("objects", "runs"), [(12, 1), (9, 3)])
def test_as_by_brute_force(objects: int, runs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    of = scattered(objects, runs, 40, seed=4)
    origin = np.random.default_rng(5).uniform(-2, 2, (2, 40))
    expected = slow(of, origin)
    assert 0.05 < expected.mean() < 0.5
    monkeypatch.setattr(view, "CHUNK", 1000)
    np.testing.assert_array_equal(occluded(of, np.arange(40), origin), expected)


def test_only_some_instants() -> None:
    of = scattered(8, 1, 30, seed=1)
    steps, origin = np.array([3, 9, 20]), np.zeros((2, 3))
    every = occluded(of, np.arange(30), np.zeros((2, 30)))
    np.testing.assert_array_equal(occluded(of, steps, origin), every[steps])


def test_a_truck_hides_a_car_and_a_car_no_truck() -> None:
    at = np.array([[20.0, 0.0], [30.0, 0.0], [-10.0, 0.0]])
    x, y = at.T[:, None, :, None]
    of = truth(np.zeros(1), x, y, 0 * x, 0 * x)
    of = replace(of, length=np.array([10.0, 4.5, 4.5]), width=np.array([2.5, 1.8, 1.8]))
    assert occluded(of, np.array([0]), np.zeros((2, 1)))[0, :, 0].tolist() == [False, True, False]
    of = replace(of, length=np.array([4.5, 10, 4.5]), width=np.array([1.2, 2.5, 1.8]))
    assert not occluded(of, np.array([0]), np.zeros((2, 1))).any()


def test_segments_and_a_box_by_hand() -> None:
    starts = np.array([(-5, 0), (-5, 3), (-5, 0), (0, 0), (-5, -5), (0, 2)], dtype=float).T
    ends = np.array([(5, 0), (5, 3), (-3, 0), (9, 9), (5, 4.9), (0, 9)], dtype=float).T
    assert crosses(starts, ends, 2.0, 1.0).tolist() == [True, False, False, True, True, False]


def test_what_is_no_target_hides_targets_as_among_all() -> None:
    of = scattered(9, 2, 12, seed=4)
    of = replace(of, target=np.arange(9) % 3 == 0)
    steps, origin = np.arange(12), np.zeros((2, 12))
    alone = of.with_hiders()
    assert alone.ids == tuple(of.ids[i] for i in (0, 3, 6))
    np.testing.assert_array_equal(occluded(alone, steps, origin), occluded(of, steps, origin)[:, of.target])
