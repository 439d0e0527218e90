"""A tracker of several objects in a scenario with known identities: it fails alone, and is told of the key."""

from __future__ import annotations

import numpy as np
import pytest

import trackbench as tb
from trackbench import Tracks

SCENE = {
    "name": "known",
    "truth": {
        "source": "scripted",
        "duration_s": 2,
        "rate_hz": 10,
        "observer": {"x": 0, "y": 0, "yaw_deg": 0},
        "objects": {name: {"start": {"x": x, "speed_mps": 5}} for name, x in (("a", 20), ("b", 40))},
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.1}},
    "monte_carlo": {"runs": 2},
}
KEY = "sensing: {identities: hidden}"


class GivesTracks:
    def step(self, state, scan):
        return 1, Tracks(np.array([0]), np.zeros((4, 1)), np.eye(4)[..., None])


class GivesTracksOfAllRuns:
    batched = True

    def step(self, state, scan):
        return 1, Tracks(np.zeros((1, 2), int), np.zeros((4, 1, 2)), np.zeros((4, 4, 1, 2)))


class UnpacksTheShape:
    def step(self, state, scan):
        m, D = scan.measurement.shape
        return 1, (np.zeros((m, D)), np.eye(4))


class FailsLater:
    def step(self, state, scan):
        if state is not None:
            raise IndexError("of its own")
        return 1, (np.array([20.0, 0, 5, 0]), np.eye(4))


def cause_of(tracker: type) -> str:
    result = tb.run(
        {**SCENE, "trackers": {"raw": {"use": "raw"}, "mine": {"use": f"{__name__}:{tracker.__name__}"}}},
        in_process=True,
    )
    assert [each.name for each in result.scored] == ["raw"]
    return str(result["mine"].failed)


@pytest.mark.parametrize(
    "tracker",
    [GivesTracks, GivesTracksOfAllRuns, UnpacksTheShape],
)
def test_a_tracker_of_several_objects_is_told_of_the_key(tracker: type) -> None:
    assert KEY in cause_of(tracker)


def test_a_tracker_of_one_object_is_not_asked() -> None:
    assert KEY not in cause_of(FailsLater)
