"""SIAP against Stone Soup, where no track has gaps."""

from __future__ import annotations

import datetime

import numpy as np
import pytest
from stonesoup.measures import Euclidean
from stonesoup.metricgenerator.manager import MultiManager
from stonesoup.metricgenerator.tracktotruthmetrics import SIAPMetrics
from stonesoup.types.association import AssociationSet, TimeRangeAssociation
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.state import State
from stonesoup.types.time import TimeRange
from stonesoup.types.track import Track
from tests.metrics.traffic.histories import counted_of, tracks_of, truth_of

from trackbench.metrics.traffic.track_quality import siap

CUTOFF = 5.0
BEGIN = datetime.datetime(2000, 1, 1)


@pytest.mark.parametrize("seed", range(5))
def test_siap_equals_stone_soup(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(0, 1, (12, 4)), axis=0) + np.arange(4) * 6
    y = np.cumsum(rng.normal(0, 1, (12, 6)), axis=0) + np.arange(6) * 5
    for position, last in ((x, rng.integers(4, 13, 4)), (y, rng.integers(4, 13, 6))):
        position[np.arange(12)[:, None] >= last] = np.nan
    truth, tracks = truth_of(x), tracks_of(y)
    truth.state[2:], tracks.mean[2:] = rng.normal(0, 3, (2, 12, 4)), rng.normal(0, 3, (2, 12, 6))
    moments = [BEGIN + datetime.timedelta(seconds=float(second)) for second in truth.time]

    def states(kind: type, state: np.ndarray, column: int) -> list[State]:
        return [
            kind(now[:, None], timestamp=moment)
            for now, moment in zip(state[:, :, column].T, moments, strict=True)
            if np.isfinite(now[0])
        ]

    objects = [GroundTruthPath(states(GroundTruthState, truth.state, item)) for item in range(4)]
    found = [Track(states(State, tracks.mean, column)) for column in range(6)]
    near = np.abs(y[:, None] - x[:, :, None])
    associations = set()
    for k, moment in enumerate(moments):
        for column in range(6):
            distance = np.where(np.isnan(near[k, :, column]), np.inf, near[k, :, column])
            item = int(distance.argmin())
            if distance[item] <= CUTOFF:
                pair = {objects[item], found[column]}
                lasting = TimeRange(moment, moment + datetime.timedelta(milliseconds=1))
                associations.add(TimeRangeAssociation(pair, time_range=lasting))
    generator = SIAPMetrics(position_measure=Euclidean((0, 1)), velocity_measure=Euclidean((2, 3)))
    manager = MultiManager([generator])
    manager.add_data({"groundtruth_paths": objects, "tracks": found})
    manager.association_set = AssociationSet(associations)
    theirs = {metric.title: metric.value for metric in generator.compute_metric(manager)}
    ours = siap(truth, tracks, counted_of(truth, tracks, CUTOFF))
    names = ("Completeness", "Ambiguity", "Spuriousness", "Position Accuracy", "Velocity Accuracy")
    for (total, number), name in zip(ours.values(), names, strict=True):
        assert total / number == pytest.approx(theirs[f"SIAP {name}"], rel=1e-9), name
