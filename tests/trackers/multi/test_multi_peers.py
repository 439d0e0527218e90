"""Nearest neighbour and JPDA beside Stone Soup's on the same scans."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.peers import ACCELERATION_SIGMA
from tests.support.traffic_peers import stonesoup_tracks
from tests.support.traffic_scans import traffic, vehicles

from trackbench.base.types import scan_of_run
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

GATE = 0.9999


@pytest.mark.parametrize(("method", "spacing"), [("gnn", 8.0), ("gnn", 1.5), ("jpda", 8.0), ("jpda", 1.5)])
def test_the_estimates_where_both_hold_the_same_association(method: str, spacing: float) -> None:
    count, dt = 4, 0.05
    start = vehicles(count, spacing=spacing)
    start[1] = 20.0
    seen = traffic(start, 18, detection=0.9, clutter=60.0, seed=11)
    # All tracks start from one scan that has every object and nothing else; none starts later.
    first = traffic(start, 1, detection=1.0, clutter=0.0, sensors=("lidar",)).scans[0]
    of = build_multi(
        FilterConfig.model_validate(
            {
                "filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": ACCELERATION_SIGMA,
                "initial": {"from": "first_measurement", "sensors": ["start"], "velocity_sigma_mps": 4.0},
                "associate": {"method": method, "gate": GATE, "confirm": [1, 1], "delete_after_s": 9.0},
            }
        )
    ).tracker  # fmt: skip
    state, begun = of.step(None, scan_of_run(first._replace(sensor="start"), 0))
    scans = [scan_of_run(scan, 0)._replace(time=scan.time + dt) for scan in seen.scans]
    peer = stonesoup_tracks(begun.mean, begun.covariance, first.time, scans, method, GATE)
    same = np.ones(count, dtype=bool)
    compared = 0
    for scan, (mean, covariance, used) in zip(scans, peer, strict=True):
        state, tracks = of.step(state, scan)
        # An association that differs once makes all later estimates differ.
        if method == "gnn":
            same &= tracks.used == used
        assert method == "gnn" or np.array_equal(tracks.used, used)
        np.testing.assert_allclose(tracks.mean[:, same], mean[:, same], rtol=0, atol=1e-6)
        np.testing.assert_allclose(tracks.covariance[..., same], covariance[..., same], rtol=0, atol=1e-6)
        compared += np.count_nonzero(same)
    assert compared > (0.9 if method == "jpda" or spacing > 2 else 0.1) * count * len(scans)
