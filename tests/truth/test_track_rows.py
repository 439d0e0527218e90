"""The table of tracks, and what formats that know no more than bodies make of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trackbench.base.errors import InputError
from trackbench.truth.tracks import TrackRows, TrafficTrack, rows_of

TIME = np.array([0.2, 0.0, 0.1])


def test_rows_of_bodies_keep_what_only_some_of_them_state():
    bodies = [
        TrafficTrack("a", TIME[:2], TIME[:2], TIME[:2], heading=TIME[:2], length=4.0, kind="car"),
        TrafficTrack("b", TIME[:1], TIME[:1], TIME[:1]),
    ]
    table = rows_of(bodies)
    assert list(table.id) == ["a", "a", "b"]
    assert list(table.kind or ()) == ["car", "car", ""]
    np.testing.assert_array_equal(table.heading, [0.2, 0.0, np.nan])
    np.testing.assert_array_equal(table.length, [4.0, 4.0, np.nan])
    assert table.width is None
    assert table.speed is None


def test_ordered_rows_keep_their_columns_together():
    covariance = np.arange(48.0).reshape(4, 4, 3)
    table = TrackRows(["x", "y", "z"], TIME, TIME + 1, TIME + 2, covariance=covariance, run=["0", "1", "0"])
    ordered = table.ordered(Path("a.csv"))
    assert list(ordered.id) == ["y", "z", "x"]
    assert list(ordered.run or ()) == ["1", "0", "0"]
    np.testing.assert_array_equal(ordered.px - ordered.time, 1.0)
    np.testing.assert_array_equal(ordered.covariance, covariance[..., [1, 2, 0]])


def test_one_id_at_one_time_is_one_row_of_a_run():
    twice = TrackRows(["x", "x"], np.zeros(2), np.zeros(2), np.ones(2), run=["0", "1"])
    assert len(twice.ordered(Path("a.csv"))) == 2
    with pytest.raises(InputError, match=r"a\.csv: x has two rows at 0 s"):
        TrackRows(["x", "x"], np.zeros(2), np.zeros(2), np.ones(2)).ordered(Path("a.csv"))
