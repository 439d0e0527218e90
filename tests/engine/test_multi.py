"""Trackers of several objects by either engine: the same decisions, and the same tracks but for rounding."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from tests.support.scenes import NOISE
from tests.support.traffic_scans import traffic, vehicles

from trackbench.trackers.associate import AssociationMethod
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import MultiObjectTracker, build_multi

CV, CA, CTRV = ({"model": name, **NOISE[name]} for name in ("cv", "ca", "ctrv"))
FILTERS = {
    "kf": ("kf", CV),
    "ekf": ("ekf", CTRV),
    "ekf of ca": ("ekf", CA),
    "ukf": ("ukf", CTRV),
    "ckf": ("ckf", CV),
    "imm": ("ekf", {"imm": [CV, CTRV], "stay_s": [3, 2]}),
}
#: Largest difference of a mean, in standard deviations, and of a covariance, in its largest entry.
ROUNDING = 1e-8


def tracker(filter_name, motion, method, initial=None) -> MultiObjectTracker:
    given = {"filter": filter_name, "motion": motion, "associate": {"method": method}}
    return build_multi(FilterConfig.model_validate(given | ({} if initial is None else {"initial": initial}))).tracker


def assert_same_tracks(of, seen) -> None:
    fused = replace(of, engine="fused")
    states = [None, None]
    for scan, origins in zip(seen.scans, seen.origins, strict=True):
        told = (np.stack([origins, np.full_like(origins, -1)]),) if of.wants_origins else ()
        states[0], a = of.step(states[0], scan, *told)
        states[1], b = fused.step(states[1], scan, *told)
        np.testing.assert_array_equal(b.ids, a.ids)
        np.testing.assert_array_equal(b.used, a.used)
        sigma = np.sqrt(np.einsum("ii...->i...", a.covariance))
        assert np.nanmax(np.abs(b.mean - a.mean) / sigma, initial=0.0) < ROUNDING
        scale = sigma[:, None] * sigma[None]
        assert np.nanmax(np.abs(b.covariance - a.covariance) / scale, initial=0.0) < ROUNDING
        if a.existence is not None:
            assert np.nanmax(np.abs(b.existence - a.existence), initial=0.0) < ROUNDING
    assert a.ids.size
    # Where a branch goes the other way, a member is computed again by NumPy.
    assert fused.engine_used.engine != "numpy"
    assert not fused.engine_used.why_numpy


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize("method", get_args(AssociationMethod))
def test_every_method(method, runs):
    seen = traffic(vehicles(6, spacing=9.0), 15, runs, detection=0.9, clutter=6.0, seed=runs)
    assert_same_tracks(tracker("ekf", CV, method), seen)


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("method", ["gnn", "jipda"])
@pytest.mark.parametrize("name", FILTERS)
def test_every_filter(name, method):
    seen = traffic(vehicles(5, spacing=9.0), 12, 2, detection=0.9, clutter=4.0, seed=5)
    assert_same_tracks(tracker(*FILTERS[name], method), seen)


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("velocity", ["zero", "radial", "range_rate"])
def test_every_start(velocity):
    seen = traffic(vehicles(5), 10, 2, detection=0.9, clutter=2.0, seed=6)
    initial = {"from": "first_measurement", "velocity": velocity, "velocity_sigma_mps": 7.0}
    assert_same_tracks(tracker("ekf", CTRV, "gnn", initial), seen)
