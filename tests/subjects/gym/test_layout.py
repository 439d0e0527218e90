"""Observations: what is in a row, that they are always in the space, and that they can be read back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackbench.base.types import Observer, Tracks
from trackbench.subjects.gym.layout import CORRELATIONS, DEFAULT, FEATURES, ObservationLayout

RANGES = {"x": (-200.0, 200.0), "y": (-16.0, 16.0), "vx": (-80.0, 80.0), "vy": (-80.0, 80.0)}


def ego(*state: float) -> Observer:
    px, py, vx, vy = (np.array([value]) for value in state)
    return Observer(px, py, np.zeros(1), vx, vy, np.zeros(1))


def tracks(mean: np.ndarray, covariance: np.ndarray, existence: np.ndarray | None = None) -> Tracks:
    return Tracks(np.arange(mean.shape[1]), mean, covariance, existence)


def test_a_row_in_si_units_and_in_the_axes_of_highway_env() -> None:
    layout = ObservationLayout(3, FEATURES, RANGES, normalised=False)
    root = np.array([[0.4, 0, 0, 0], [0.1, 0.3, 0, 0], [0.2, 0.1, 0.5, 0], [-0.1, 0.2, 0.1, 0.6]])
    covariance = root @ root.T
    state = np.array([[12.0], [3.0], [21.0], [-1.0]])
    rows = layout.from_array(
        layout.observe(ego(2.0, 1.0, 20.0, 0.5), tracks(state, covariance[..., None], np.array([0.9])))
    )
    assert rows["presence"].tolist() == [1.0, 1.0, 0.0]
    # The ego itself, then the track relative to it; left is negative.
    wanted = {"x": [2.0, 10.0], "y": [-1.0, -2.0], "vx": [20.0, 1.0], "vy": [-0.5, 1.5]}
    for name, values in wanted.items():
        assert rows[name][:2] == pytest.approx(values)
    deviation = np.sqrt(np.diag(covariance))
    for name, value in zip(("std_x", "std_y", "std_vx", "std_vy"), deviation, strict=True):
        assert rows[name][1] == pytest.approx(value)
    down = np.diag([1.0, -1.0, 1.0, -1.0])
    turned = down @ covariance @ down
    for name, (i, j) in CORRELATIONS.items():
        assert rows[name][1] == pytest.approx(turned[i, j] / (deviation[i] * deviation[j]))
    assert rows["existence"][1] == pytest.approx(0.9)
    assert all(values[2] == 0.0 for values in rows.values())


def test_the_nearest_come_first_and_the_others_are_left_out() -> None:
    layout = ObservationLayout(3, DEFAULT, RANGES, normalised=False)
    mean = np.array([[30.0, -5.0, 10.0, 100.0], [0.0] * 4, [0.0] * 4, [0.0] * 4])
    rows = layout.from_array(layout.observe(ego(0, 0, 0, 0), tracks(mean, np.zeros((4, 4, 4)))))
    assert rows["x"].tolist() == [0.0, -5.0, 10.0]
    # Not stated.
    assert rows["existence"].tolist() == [1.0, -1.0, -1.0]


numbers = st.floats(-1e9, 1e9, allow_nan=False)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(numbers, numbers, numbers, numbers), max_size=6),
    st.floats(0, 1e12),
    st.tuples(numbers, numbers, numbers, numbers),
    st.booleans(),
)
def test_whatever_is_tracked_is_in_the_space(
    states: list[tuple[float, ...]], variance: float, own: tuple[float, ...], normalised: bool
) -> None:
    layout = ObservationLayout(4, FEATURES, RANGES, normalised)
    mean = np.array(states, dtype=float).reshape(-1, 4).T
    covariance = np.broadcast_to((variance * np.eye(4))[:, :, None], (4, 4, mean.shape[1]))
    assert layout.observe(ego(*own), tracks(mean, covariance)) in layout.space()


def test_the_space_is_normalised_or_in_si_units() -> None:
    space, plain = (
        ObservationLayout(2, DEFAULT, RANGES).space(),
        ObservationLayout(2, DEFAULT, RANGES, normalised=False).space(),
    )
    assert space.low.min() == -1.0
    assert space.high.max() == 1.0
    assert plain.high[0].tolist() == [1, 200, 16, 80, 80, 10, 10, 10, 10, 1]
    assert plain.low[0].tolist() == [0, -200, -16, -80, -80, 0, 0, 0, 0, -1]
