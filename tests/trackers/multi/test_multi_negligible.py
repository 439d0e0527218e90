"""Pairs of negligible weight, which the Poisson multi-Bernoulli filter leaves out, and by how much that changes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.support.traffic_scans import traffic, vehicles

from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import association, build_multi


def test_the_tracks_are_the_same_but_for_a_small_share_of_their_deviation(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3.0, "associate": {"method": "pmb"}}
    tracker = replace(build_multi(FilterConfig.model_validate(keys)).tracker, engine="numpy")
    seen = traffic(vehicles(20), 40, clutter=100.0)
    followed = []
    for negligible in (association.NEGLIGIBLE, 0.0):
        monkeypatch.setattr(association, "NEGLIGIBLE", negligible)
        state, tracks = None, []
        for scan in seen.scans:
            state, answer = tracker.step(state, scan)
            tracks.append(answer)
        followed.append(tracks)
    changed = 0.0
    for pruned, exact in zip(*followed, strict=True):
        np.testing.assert_array_equal(pruned.ids, exact.ids)
        assert pruned.existence is not None
        np.testing.assert_allclose(pruned.existence, exact.existence, atol=1e-3)
        deviation = np.sqrt(np.einsum("iik->ik", exact.covariance[..., 0]))
        changed = max(changed, float((np.abs(pruned.mean - exact.mean)[..., 0] / deviation).max(initial=0.0)))
    assert 0.0 < changed < 1e-4
