"""Simulation of highway-env whose ego a program drives step by step, with the truth from the start to now."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.envs.common.action import MultiAgentAction

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Truth
from trackbench.truth.config.highway import HighwayOptions
from trackbench.truth.environment import Recorder, rates_at_instants
from trackbench.truth.frames import with_sizes
from trackbench.truth.highway import DriverModel, control_of, isolated, prepare_env, step_count

#: Number of places for bodies added to the truth when new vehicles appear.
MORE_PLACES = 16


class DrivenTraffic:
    """Episode of traffic in which a program drives the ego vehicle.

    Args:
        config: environment and seed; the options ego, observer and targets are not used.

    Raises:
        InputError: an unknown id or key, a value of the wrong type, rates that do not divide, several agents.
    """

    def __init__(self, config: HighwayOptions) -> None:
        self._config = config.model_copy(update={"ego": "idle"})
        self._driver_model: DriverModel = {}
        with isolated(self._driver_model):
            self.env = prepare_env(self._config)
            if isinstance(self.env.action_type, MultiAgentAction):
                self.env.close()
                raise InputError("several agents are not possible", key="truth.config.action")
            self._recorder = Recorder(self.env, control_of(self.env, self._config))
        self._places = len(self._recorder)
        self._dt = 1.0 / config.rate_hz
        self.times: Array = np.arange(step_count(config), dtype=np.float64) * self._dt
        """``(steps,)`` times of the longest possible episode, s."""

    def step(self, action: Any) -> tuple[float, bool, bool]:
        """Drive the ego by ``action``, an element of the environment's action space, until the next decision.

        Returns:
            Reward of the environment, whether it has ended the episode, and whether its time limit has passed.
        """
        with isolated(self._driver_model):
            _, reward, terminated, truncated, _ = self.env.step(action)
        return float(reward), bool(terminated), bool(truncated)

    def truth(self) -> Truth:
        """Return the motion of all vehicles except the ego, the observer, from the start to now."""
        if self._places < len(self._recorder):
            # Noise is drawn for all places at once, so that more places change all later noise.
            self._places = len(self._recorder) + MORE_PLACES
        frames = self._recorder.until_now(self._dt, self._places)
        if self._config.sizes is not None:
            frames = with_sizes(frames, self._config.sizes, self._config.seed)
        truth = frames.truth(range(1, len(frames.ids)), frames.carrier(0))
        return rates_at_instants(truth, np.ones(len(truth.ids), dtype=bool))
