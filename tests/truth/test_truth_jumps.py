"""Velocity jumps: found where a velocity changes by more than a car can do, counted, and said."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackbench.base.types import Truth
from trackbench.truth.jumps import IMPOSSIBLE_MPS2, after_jump, velocity_jumps
from trackbench.truth.scripted import script
from trackbench.truth.sources import ScriptedTruth

CORNER = {"start": {"speed_mps": 10}, "pieces": [{"waypoints": [[20, 0], [20, 50]]}]}
BEND = {"start": {"speed_mps": 5}, "pieces": [{"turn_rate_degps": 30}]}


def scripted(objects: dict[str, Any], rate_hz: int = 10) -> Truth:
    given = {"duration_s": 5, "rate_hz": rate_hz, "objects": objects}
    return script(ScriptedTruth.model_validate({"source": "scripted", **given}), 0, "test", 1)


def test_a_right_angle_is_one_jump_of_known_size() -> None:
    truth = scripted({"round": BEND, "corner": CORNER})
    jumped = velocity_jumps(truth)
    assert jumped.shape == (50, 2, 1)
    # The corner is reached at 2 s, which is step 20.
    assert np.argwhere(jumped).tolist() == [[19, 1, 0]]
    found = truth.audit["velocity_jumps"]
    assert (found["count"], found["object"], found["time_s"]) == (1, "corner", 2.0)
    assert found["largest_mps"] == pytest.approx(10 * np.sqrt(2))
    assert found["peak_acceleration_mps2"] == pytest.approx(100 * np.sqrt(2))
    assert truth.audit["verdict"] == "exact"


def test_a_bend_has_no_jump_and_the_acceleration_of_its_chord() -> None:
    found = scripted({"round": BEND}).audit["velocity_jumps"]
    assert found["count"] == 0
    assert (found["largest_mps"], found["object"], found["time_s"]) == (None, None, None)
    chord = 2 * 5 * np.sin(np.deg2rad(30) * 0.1 / 2) / 0.1
    assert found["peak_acceleration_mps2"] == pytest.approx(chord)


@pytest.mark.parametrize(("share", "jumps"), [(0.999, 0), (1.001, 1)])
@pytest.mark.parametrize("rate_hz", [10, 20])
def test_the_limit_is_an_acceleration(share: float, jumps: int, rate_hz: int) -> None:
    truth = scripted({"a": {"start": {"speed_mps": 5}}}, rate_hz)
    speed = truth.speed.copy()
    speed[10:] += share * IMPOSSIBLE_MPS2 / rate_hz
    assert np.count_nonzero(velocity_jumps(replace(truth, speed=speed))) == jumps


def test_what_is_absent_does_not_jump() -> None:
    truth = scripted({"corner": CORNER})
    for step in (19, 20):
        alive = truth.alive.copy()
        alive[step] = False
        assert not velocity_jumps(replace(truth, alive=alive)).any()


def test_a_jump_is_near_for_a_second_and_to_its_own_object() -> None:
    truth = scripted({"round": BEND, "corner": CORNER})
    near = after_jump(truth)
    assert near.shape == truth.px.shape
    assert not near[:, 0].any()
    assert np.flatnonzero(near[:, 1, 0]).tolist() == list(range(20, 31))
