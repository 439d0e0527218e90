"""A driver by rules: IDM for the speed and MOBIL for changes of lane, on whatever is observed of the other vehicles.

Sources: Treiber, Hennecke and Helbing (2000), "Congested traffic states in empirical observations and microscopic
simulations"; Kesting, Treiber and Helbing (2007), "General lane-changing model MOBIL for car-following models". The
values are those of highway-env's ``IDMVehicle``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from gymnasium import Env

from trackbench.base.errors import InputError
from trackbench.base.types import Array
from trackbench.subjects.gym.environment import TrackedEnv

#: Of IDM, m/s^2.
ACCELERATION, DECELERATION = 3.0, 5.0
#: Wanted distance at rest from centre to centre, m; wanted time gap, s.
DISTANCE, TIME_GAP = 10.0, 1.5
#: Of MOBIL, m/s^2: what a change has to gain, and the most that the one behind may have to brake.
GAIN, IMPOSED = 0.2, 2.0
LANE_WIDTH = 4.0
#: A vehicle whose centre is nearer to the middle of a lane than this is on it, m: it may stand out of its own.
ON_LANE = 2.4
#: No other change begins where the ego is further from the middle of its lane, m.
CENTRED = 0.5
#: For how long the movement of others across is meant to go on, s, and the own acceleration: the speeds to choose from
#: are far apart.
ACROSS, AHEAD = 1.0, 2.0
NEEDED = ("presence", "x", "y", "vx", "vy")


class Neighbour(NamedTuple):
    """A vehicle on a lane."""

    distance: float
    """From the ego's centre to its own, along the road, m; negative behind."""
    speed: float
    """m/s."""


@dataclass
class _Scene:
    speed: float
    lane: int
    offset: float
    """From the middle of the lane, m."""
    across: Array
    """``(2, K)`` where the others are now, and in a second, from the first lane's middle to the right, m."""
    along: Array
    """``(K,)`` ahead of the ego, m."""
    speeds: Array
    """``(K,)`` m/s."""

    def neighbours(self, lane: int) -> tuple[Neighbour | None, Neighbour | None]:
        """The next ahead and behind on a lane."""
        on_lane = (np.abs(self.across - LANE_WIDTH * lane) < ON_LANE).any(axis=0)
        ahead, behind = np.flatnonzero(on_lane & (self.along > 0.0)), np.flatnonzero(on_lane & (self.along <= 0.0))
        first = None if not len(ahead) else ahead[np.argmin(self.along[ahead])]
        last = None if not len(behind) else behind[np.argmax(self.along[behind])]
        front, back = (
            None if i is None else Neighbour(float(self.along[i]), float(self.speeds[i])) for i in (first, last)
        )
        return front, back


class IdmMobil:
    """Drives on straight lanes by highway-env's discrete meta actions. Where nothing is observed the road is empty.

    Args:
        env: a ``trackbench/Tracked-v0`` of ``highway-v0`` or ``highway-fast-v0``.
        speed: wanted on an empty road, m/s.

    Raises:
        InputError: the environment has no straight lanes, other actions, or features that do not suffice.
    """

    def __init__(self, env: Env[Any, Any], speed: float = 30.0) -> None:
        tracked = env.unwrapped
        if not isinstance(tracked, TrackedEnv):
            raise InputError(f"IdmMobil drives in trackbench/Tracked-v0, not in {tracked}")
        self._layout, config = tracked.layout, tracked.highway.config
        if "lanes_count" not in config:
            raise InputError("IdmMobil drives on straight lanes, as of highway-v0", key="env")
        actions = getattr(tracked.highway.action_type, "actions_indexes", {})
        if not {"LANE_LEFT", "LANE_RIGHT", "FASTER", "SLOWER", "IDLE"} <= set(actions):
            raise InputError("IdmMobil needs DiscreteMetaAction with speeds and lanes", key="config.action")
        if missing := [name for name in NEEDED if name not in self._layout.features]:
            raise InputError(f"IdmMobil needs the features {', '.join(missing)}", key="features")
        self._actions, self._lanes, self._wanted = actions, int(config["lanes_count"]), speed
        self._speeds = np.asarray(tracked.highway.action_type.target_speeds, dtype=float)
        self._target: float | None = None

    def reset(self) -> None:
        """An episode begins."""
        self._target = None

    def act(self, observation: Array) -> int:
        """The action, from an observation of the environment."""
        scene = self._scene(observation)
        now, best, direction = self._acceleration(scene, scene.lane), GAIN, None
        for name, lane in (("LANE_LEFT", scene.lane - 1), ("LANE_RIGHT", scene.lane + 1)):
            if 0 <= lane < self._lanes and abs(scene.offset) < CENTRED:
                there = self._acceleration(scene, lane)
                if there > -IMPOSED and there - now > best and self._is_safe(scene, lane):
                    best, direction = there - now, name
        return int(self._actions[direction or self._change_of_speed(scene.speed, now)])

    def _scene(self, observation: Array) -> _Scene:
        columns = self._layout.from_array(observation)
        there = columns["presence"][1:] > 0.5
        own_y, speed = float(columns["y"][0]), float(columns["vx"][0])
        lane = min(max(round(own_y / LANE_WIDTH), 0), self._lanes - 1)
        along, beside = columns["x"][1:][there], own_y + columns["y"][1:][there]
        sideways = float(columns["vy"][0]) + columns["vy"][1:][there]
        across = np.stack([beside, beside + sideways * ACROSS])
        return _Scene(speed, lane, own_y - LANE_WIDTH * lane, across, along, speed + columns["vx"][1:][there])

    def _acceleration(self, scene: _Scene, lane: int) -> float:
        """Of the ego on a lane, m/s^2."""
        front, _ = scene.neighbours(lane)
        return idm(scene.speed, self._wanted, front)

    def _is_safe(self, scene: _Scene, lane: int) -> bool:
        """Whether the one behind on that lane does not have to brake more than it may be asked to."""
        _, back = scene.neighbours(lane)
        return back is None or idm(back.speed, math.inf, Neighbour(-back.distance, scene.speed)) > -IMPOSED

    def _change_of_speed(self, speed: float, acceleration: float) -> str:
        """The action whose target speed is nearest to that which the acceleration leads to."""
        nearest = int(np.argmin(np.abs(self._speeds - speed)))
        self._target = float(self._speeds[nearest]) if self._target is None else self._target
        targets = {
            "IDLE": self._target,
            "SLOWER": float(self._speeds[max(nearest - 1, 0)]),
            "FASTER": float(self._speeds[min(nearest + 1, len(self._speeds) - 1)]),
        }
        wanted = speed + acceleration * AHEAD
        action = min(targets, key=lambda name: abs(targets[name] - wanted))
        self._target = targets[action]
        return action


def idm(speed: float, wanted: float, front: Neighbour | None) -> float:
    """The acceleration behind a vehicle, or on an empty road, m/s^2."""
    acceleration = ACCELERATION * (1.0 - (max(speed, 0.0) / wanted) ** 4)
    if front is not None:
        closing = speed * (speed - front.speed) / (2.0 * math.sqrt(ACCELERATION * DECELERATION))
        gap = DISTANCE + max(0.0, speed * TIME_GAP + closing)
        acceleration -= ACCELERATION * (gap / max(front.distance, 0.1)) ** 2
    return acceleration
