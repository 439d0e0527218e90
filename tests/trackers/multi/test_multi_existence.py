"""Of the tracks that say that an object exists with some probability, that share are real."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from tests.support.traffic_scans import NOISE, RANGE

from trackbench.base.types import Array, FieldOfView, Mask, Scan
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

OBJECTS, FALSE_ALARMS, DETECTION, VELOCITY_SIGMA, DT = 6.0, 30.0, 0.7, 5.0, 0.1


class Said(NamedTuple):
    """Of all tracks after one scan."""

    existence: Array
    real: Mask


def uniform(random: np.random.Generator, shape: tuple[int, int]) -> Array:
    """``(2, *shape)`` positions in view."""
    away, angle = RANGE * np.sqrt(random.random(shape)), random.uniform(-np.pi, np.pi, shape)
    return away * np.array([np.cos(angle), np.sin(angle)])


def followed(random: np.random.Generator, method: str, runs: int, scans: int) -> list[Said]:
    """Objects as the tracker assumes them: their number Poisson, uniform in view, with normal velocities."""
    counts = random.poisson(OBJECTS, runs)
    most = int(counts.max())
    start = uniform(random, (most, runs))
    velocity = VELOCITY_SIGMA * random.normal(size=start.shape)
    exists = np.arange(most)[:, None] < counts
    keys = {
        "filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 1.0,
        "initial": {"from": "first_measurement", "velocity_sigma_mps": VELOCITY_SIGMA},
        "associate": {
            "method": method, "undetected": OBJECTS, "birth_rate_hz": 1e-6, "lifetime_s": 1e6, "visible_s": None,
        },
    }  # fmt: skip
    of, state, said = build_multi(FilterConfig.model_validate(keys)).tracker, None, []
    for k in range(scans):
        place = start + k * DT * velocity
        false = random.poisson(FALSE_ALARMS, runs)
        seen = exists & (random.random(exists.shape) < DETECTION)
        alarms = uniform(random, (int(false.max()), runs))
        both = np.concatenate([place + np.sqrt(NOISE["lidar"][0]) * random.normal(size=place.shape), alarms], axis=1)
        valid = np.concatenate([seen, np.arange(alarms.shape[1])[:, None] < false])
        order = np.argsort(~valid, axis=0, kind="stable")
        both, valid = np.take_along_axis(both, order[None], axis=1), np.take_along_axis(valid, order, axis=0)
        scan = Scan(
            k * DT, "lidar", "lidar", np.where(valid, both, np.nan), valid, np.diag(NOISE["lidar"]), np.zeros(3),
            np.zeros(2), k * DT, DETECTION, FALSE_ALARMS / (np.pi * RANGE**2), FieldOfView(np.pi, RANGE),
        )  # fmt: skip
        state, _ = of.step(state, scan)
        table = state.table
        gap = np.hypot(*(table.belief.mean[:2, None] - place[:, :, table.run]))
        reach = np.maximum(3.5 * np.sqrt(table.belief.covariance[0, 0] + table.belief.covariance[1, 1]), 0.5)
        said.append(Said(table.evidence[0], ((gap < reach) & exists[:, table.run]).any(axis=0)))
    return said


@pytest.mark.parametrize("method", ["jipda", "pmb"])
def test_existence_is_calibrated(method: str) -> None:
    random = np.random.default_rng(3)
    blocks = [followed(random, method, 150, 4) for _ in range(3)]
    checked = 0
    upper = [(0.3, 0.7), (0.7, 0.95), (0.95, 1.0)]
    for after in range(4):
        existence, real = (np.concatenate([block[after][part] for block in blocks]) for part in (0, 1))
        # Later, many tracks below 0.3 are wide and lie on the object of another track.
        for low, high in [(0.1, 0.3), *upper] if after == 0 else upper:
            own = (existence >= low) & (existence <= high)
            if own.sum() < 50:
                continue
            expected, found = existence[own], real[own]
            deviation = np.sqrt((expected * (1 - expected)).sum())
            assert abs(found.sum() - expected.sum()) < 4 * deviation, (after, low, expected.mean(), found.mean())
            checked += 1
    assert checked >= 9
