"""The driver by rules against closed forms of IDM, and where it changes lanes and where not."""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from highway_env.vehicle.behavior import IDMVehicle

import trackbench.gym
from trackbench import InputError
from trackbench.base.types import Observer, Tracks
from trackbench.subjects.gym.agent import ACCELERATION, DECELERATION, DISTANCE, TIME_GAP, Neighbour, idm

ACTIONS = {"LANE_LEFT": 0, "IDLE": 1, "LANE_RIGHT": 2, "FASTER": 3, "SLOWER": 4}


@pytest.fixture(scope="module")
def env() -> Any:
    config = {
        "action": {"type": "DiscreteMetaAction", "target_speeds": [0, 5, 10, 15, 20, 25, 30]},
        "vehicles_count": 2,
    }
    made = gymnasium.make(trackbench.gym.ID, env="highway-v0", config=config, tracker="truth", rows=6)
    yield made
    made.close()


def action(env: Any, lane: int, speed: float, *others: tuple[float, int, float], drift: float = 0.0) -> str:
    """What the driver does on a lane, from the left, at a speed, among others: ahead by m, lane, speed in m/s."""
    one = np.ones(1)
    ego = Observer(0 * one, -4.0 * lane * one, 0 * one, speed * one, 0 * one, 0 * one)
    mean = np.array([[ahead, -4.0 * other, v, -drift] for ahead, other, v in others]).reshape(-1, 4).T
    tracks = Tracks(np.arange(len(others)), mean, np.zeros((4, *mean.shape)))
    driver = trackbench.gym.IdmMobil(env)
    number = driver.act(env.unwrapped.layout.observe(ego, tracks))
    return next(name for name, value in ACTIONS.items() if value == number)


def test_the_values_are_those_of_highway_env() -> None:
    own = (IDMVehicle.COMFORT_ACC_MAX, -IDMVehicle.COMFORT_ACC_MIN, IDMVehicle.DISTANCE_WANTED, IDMVehicle.TIME_WANTED)
    assert own == (ACCELERATION, DECELERATION, DISTANCE, TIME_GAP)


@pytest.mark.parametrize("speed", [0.0, 10.0, 30.0])
def test_an_empty_road(speed: float) -> None:
    assert idm(speed, 30.0, None) == pytest.approx(3.0 * (1.0 - (speed / 30.0) ** 4))


def test_equilibrium_behind_a_car_of_the_same_speed() -> None:
    speed, wanted = 20.0, 30.0
    gap = (DISTANCE + speed * TIME_GAP) / math.sqrt(1.0 - (speed / wanted) ** 4)
    assert idm(speed, wanted, Neighbour(gap, speed)) == pytest.approx(0.0, abs=1e-12)
    assert idm(speed, wanted, Neighbour(gap - 5.0, speed)) < 0.0 < idm(speed, wanted, Neighbour(gap + 5.0, speed))


def test_it_drives_faster_where_nobody_is_seen_and_keeps_the_wanted_speed(env: Any) -> None:
    assert action(env, 1, 20.0) == "FASTER"
    assert action(env, 1, 30.0) == "IDLE"


def test_it_brakes_where_no_lane_is_free(env: Any) -> None:
    blocked = [(25.0, lane, 15.0) for lane in range(4)]
    assert action(env, 1, 25.0, *blocked) == "SLOWER"


def test_it_overtakes_on_a_free_lane_and_not_in_front_of_a_faster_car(env: Any) -> None:
    slow = (40.0, 0, 18.0)
    assert action(env, 0, 25.0, slow) == "LANE_RIGHT"
    assert action(env, 0, 25.0, slow, (-15.0, 1, 30.0)) != "LANE_RIGHT"
    # As far behind as it needs not brake.
    assert action(env, 0, 25.0, slow, (-120.0, 1, 27.0)) == "LANE_RIGHT"
    assert action(env, 3, 25.0, (40.0, 3, 18.0)) == "LANE_LEFT"


def test_a_car_that_comes_over_is_taken_for_one_ahead(env: Any) -> None:
    beside = [(20.0, lane, 15.0) for lane in (0, 2)]
    assert action(env, 1, 20.0, *beside) == "FASTER"
    # To the right with 3 m/s: the one on the left lane will be ahead.
    assert action(env, 1, 20.0, *beside, drift=3.0) in ("SLOWER", "LANE_LEFT")


def test_where_it_cannot_drive(env: Any) -> None:
    for options, message in (
        ({"env": "roundabout-v0", "config": {}}, "straight lanes"),
        ({"config": {"action": {"type": "ContinuousAction"}}}, "DiscreteMetaAction"),
        ({"features": ["presence", "x", "y"]}, "needs the features vx, vy"),
    ):
        other = gymnasium.make(trackbench.gym.ID, **{"env": "highway-v0", "tracker": "truth", **options})
        with pytest.raises(InputError, match=message):
            trackbench.gym.IdmMobil(other)
        other.close()
    with pytest.raises(InputError, match="drives in trackbench/Tracked-v0"):
        trackbench.gym.IdmMobil(env.unwrapped.highway)
