"""What trackers of several objects ask of a filter, and the probabilities of clusters, by kernels and by NumPy."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from tests.engine.compared import compared
from tests.engine.test_multi import FILTERS
from tests.support.traffic_scans import traffic, vehicles

from trackbench.base.types import Scan
from trackbench.engine.beliefs import belief_values
from trackbench.engine.filters import fused_filter
from trackbench.engine.kernels import Kernels
from trackbench.filters import AnyBelief
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi
from trackbench.trackers.multi.fused_tracks import MOST_SLOTS, FusedTrackFilter
from trackbench.trackers.multi.gate import run_detections
from trackbench.trackers.multi.mixture import ENUMERATION, MOST_TERMS
from trackbench.trackers.multi.table import PredictedTracks, TrackFilter

pytestmark = pytest.mark.usefixtures("kernels")


def both(name: str) -> tuple[TrackFilter, FusedTrackFilter]:
    filter_name, motion = FILTERS[name]
    of = build_multi(
        FilterConfig.model_validate({"filter": filter_name, "motion": motion, "associate": {"method": "gnn"}})
    ).tracker
    return TrackFilter(of.filter, of.initial), FusedTrackFilter(fused_filter(of.filter), of.initial)


def scans() -> list[Scan]:
    """Two of a lidar, each of the detections of all runs."""
    seen = traffic(vehicles(7, spacing=6.0), 2, 3, detection=0.95, clutter=3.0, sensors=("lidar",), dt=0.1, seed=1)
    return [run_detections(scan, as_listed=False).scan for scan in seen.scans]


def assert_close(found: AnyBelief, expected: AnyBelief) -> None:
    told = belief_values(found)
    for name, wanted in belief_values(expected).items():
        if name in told:
            scale = np.maximum(np.abs(wanted), 1.0)
            np.testing.assert_array_less(np.abs(told[name] - wanted) / scale, 1e-9, err_msg=name)


def predicted(name: str) -> tuple[TrackFilter, FusedTrackFilter, PredictedTracks, PredictedTracks, Scan]:
    reference, fused = both(name)
    first, second = scans()
    start, by_kernel = reference.begin(first), fused.begin(first)
    assert_close(by_kernel, start)
    expected, found = reference.expect(start, 0.1, second), fused.expect(start, 0.1, second)
    return reference, fused, expected, found, second


@pytest.mark.parametrize("most", [1, 3, MOST_SLOTS + 2])
@pytest.mark.parametrize("name", FILTERS)
def test_mixtures(name: str, most: int) -> None:
    reference, fused, at, by_kernel, scan = predicted(name)
    random = np.random.default_rng(most)
    count = random.integers(0, most + 1, len(at.in_view))
    count[5] = most
    track = np.repeat(np.arange(len(count)), count)
    detection = np.concatenate([random.permutation(len(scan.valid))[:each] for each in count])
    share = random.uniform(0.1, 1.0, len(track))
    weight = 0.8 / np.maximum(np.bincount(track, share, len(count)), 1e-9)
    share *= weight[track]
    kept = np.where(count > 0, 0.2, 1.0)
    expected = reference.mixture(at, scan, track, detection, share, kept)
    assert_close(fused.mixture(by_kernel, scan, track, detection, share, kept), expected)


@pytest.mark.parametrize(("tracks", "detections"), list(product(range(1, 6), repeat=2)))
def test_clusters(kernels: Kernels, tracks: int, detections: int) -> None:
    if tracks * detections * 2 ** min(tracks, detections) > MOST_TERMS:
        return
    random = np.random.default_rng(tracks + 7 * detections)
    weight = np.exp(random.normal(0.0, 6.0, (tracks, detections, 20)))
    weight[random.random(weight.shape) < 0.3] = 0.0
    assert compared(kernels, ENUMERATION, {"weight": weight}) == 0
