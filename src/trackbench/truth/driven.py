"""highway-env driven by an agent from step to step, and its truth up to now."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from highway_env.envs.common.action import MultiAgentAction

from trackbench.base.errors import InputError
from trackbench.base.types import Truth
from trackbench.truth.config import HighwayOptions
from trackbench.truth.environment import Recorder, rates_at_instants
from trackbench.truth.frames import with_sizes
from trackbench.truth.highway import control_of, isolated, prepare_env

#: By how many places for bodies the truth grows where vehicles come that were not there at first.
MORE_PLACES = 16


@dataclass(frozen=True)
class LatestTruth:
    """The truth since the last look, with the step before it."""

    truth: Truth
    """All vehicles but the ego, which carries the observer; the last step is now."""
    first: int
    """Number of its first step, from the start of the episode."""
    new: int
    """Number of the first step that is new."""


class DrivenTraffic:
    """Traffic among which an agent drives the ego vehicle.

    Args:
        config: the environment; who drives the ego, the observer and the targets are not used.
        render_mode: as of Gymnasium.

    Raises:
        InputError: an unknown id or key, a value of the wrong type, rates that do not divide, several agents.
    """

    def __init__(self, config: HighwayOptions, render_mode: str | None = None) -> None:
        self._config = config.model_copy(update={"ego": "idle"})
        self._classes: dict[type[Any], dict[str, Any]] = {}
        with isolated(self._classes):
            self.env = prepare_env(self._config, render_mode)
        if isinstance(self.env.action_type, MultiAgentAction):
            self.env.close()
            raise InputError("several agents are not possible", key="config.action")
        self.dt = 1.0 / config.rate_hz
        self.time_limit: float | None = self.env.config.get("duration")
        """The environment's own, s."""
        self._seed, self._looked = config.seed, -1
        self._places = 0
        self.time_gap = math.inf
        """Smallest distance to the vehicle ahead over the speed in this episode, s; infinite if there was none."""

    @property
    def now(self) -> float:
        """Since the episode began, s."""
        return len(self._recorder.frames) * self.dt

    def reset(self, seed: int | None) -> None:
        """Begin an episode; without a seed one that follows from the last."""
        self._seed = self._seed + 1 if seed is None else seed
        with isolated(self._classes):
            self.env.reset(seed=seed)
            self._recorder = Recorder(
                self.env, control_of(self.env, self._config.model_copy(update={"seed": self._seed}))
            )
        record, self._looked, self._places, self.time_gap = self._recorder, -1, len(self.env.road.vehicles), math.inf

        def step(dt: float) -> None:
            record(dt)
            self.time_gap = min(self.time_gap, self._time_gap())

        self.env.road.step = step

    def step(self, action: Any) -> tuple[float, bool, bool, dict[str, Any]]:
        """Act until the next decision.

        Returns:
            The reward, whether the episode is over, whether by its time limit, and what highway-env says of it.
        """
        with isolated(self._classes):
            _, reward, terminated, truncated, info = self.env.step(action)
        return float(reward), bool(terminated), bool(truncated), info

    def look(self) -> LatestTruth:
        """The truth since the last look."""
        first, new = max(self._looked, 0), self._looked + 1
        self._looked = len(self._recorder.frames)
        if self._places < len(self._recorder):
            # Noise is drawn for all places at once: that to come is another one from here on.
            self._places = len(self._recorder) + MORE_PLACES
        frames = self._recorder.since(first, self.dt, self._places)
        if self._config.sizes is not None:
            frames = with_sizes(frames, self._config.sizes, self._seed)
        truth = frames.truth(range(1, len(frames.ids)), frames.carrier(0))
        truth = rates_at_instants(truth, np.ones(len(truth.ids), dtype=bool))
        return LatestTruth(replace(truth, time=truth.time + first * self.dt), first, new)

    def _time_gap(self) -> float:
        ego = self.env.vehicle
        ahead, _ = self.env.road.neighbour_vehicles(ego)
        if ahead is None or ego.speed <= 0.0:
            return math.inf
        distance = ego.lane_distance_to(ahead) - 0.5 * (ego.LENGTH + ahead.LENGTH)
        return max(0.0, float(distance)) / float(ego.speed)
