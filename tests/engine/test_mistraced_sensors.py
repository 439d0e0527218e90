"""A user's sensor whose parameter changes, or that is no function of its target: as by NumPy, or it is said."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tests.engine import agreement
from tests.engine.odd_factors import COUNTERS, INPUT, STATELESS
from tests.engine.own_sensors import Scaled
from tests.engine.parameter_places import PLACES
from tests.engine.test_own_sensors import FIRST, estimates, scans
from tests.support.scenes import tracker

from trackbench.base.types import Array
from trackbench.engine.equations import EngineUsed
from trackbench.engine.kernels import Kernels
from trackbench.trackers.filtered import FilterTracker

pytestmark = pytest.mark.usefixtures("kernels")
ODD = {**COUNTERS, **INPUT, **{name: partial(lambda factor: factor, factor) for name, factor in STATELESS.items()}}


def means(engine: str) -> tuple[Array, EngineUsed]:
    """Where the tracks of a lidar end, and what computed them."""
    of = tracker(**agreement.FILTERS["ekf-cv"], initial=FIRST)
    by = of if engine == "numpy" else FilterTracker(of.filter, of.initial, engine="fused")
    last = estimates(by, scans("Scaled"))[-1]
    return last.mean, by.engine_used


@pytest.mark.parametrize("place", PLACES)
def test_a_parameter_of_a_sensor_that_is_changed_between_two_runs_counts(
    kernels: Kernels, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path))
    factor, change = PLACES[place]()
    monkeypatch.setattr(Scaled, "factor", staticmethod(factor))
    ends = []
    for value in (1.0, 1.5, 1.0):
        change(value)
        expected, _ = means("numpy")
        end, used = means("fused")
        np.testing.assert_allclose(end, expected, rtol=1e-9, atol=1e-9)
        assert used == EngineUsed("fused") or used.why_numpy
        ends.append(end)
    assert not np.allclose(ends[0], ends[1])


@pytest.mark.parametrize("name", ODD)
def test_an_odd_sensor_differs_from_numpy_only_where_it_is_said(
    kernels: Kernels, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path))
    monkeypatch.setattr(Scaled, "factor", staticmethod(ODD[name]()))
    expected, _ = means("numpy")
    monkeypatch.setattr(Scaled, "factor", staticmethod(ODD[name]()))
    end, used = means("fused")
    assert used.invalid or used.why_numpy or np.allclose(end, expected, rtol=1e-9, atol=1e-9)
