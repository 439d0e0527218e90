"""Episode of a highway-env scenario whose ego vehicle a program drives step by step."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.errors import InputError
from trackbench.base.types import Scan, Truth
from trackbench.scenario import Scenario
from trackbench.sensing.episodes import EpisodeSensing
from trackbench.truth.config.highway import HighwayOptions
from trackbench.truth.driven import DrivenTraffic


class LiveStep(NamedTuple):
    """Result of one step of a live episode; ``reward`` and ``terminated`` come from highway-env."""

    scans: list[Scan]
    """Scans that arrived in this step, in order; measurements ``(m, D)``, or ``(m, objects)`` with known identities."""
    truth: Truth
    """Motion of the ego (``truth.observer``) and of all other vehicles from the start; the last row is now."""
    reward: float
    terminated: bool
    truncated: bool
    """Whether the time limit of the scenario or of the environment is reached."""


class LiveEpisode:
    """Episode that advances by one decision of its driver at a time; :func:`live` begins one."""

    def __init__(self, scenario: Scenario, options: HighwayOptions) -> None:
        config, self._traffic = scenario.config, DrivenTraffic(options)
        noise, hidden = (config.monte_carlo.seed, config.name), config.sensing.identities == "hidden"
        self._sensing = EpisodeSensing(config.sensors, self._traffic.times, *noise, hidden)
        self.action_space: Any = self._traffic.env.action_space
        """Space of the actions that highway-env takes, of Gymnasium."""
        self.latest = self._observe(0.0, False, False)
        """Result of the latest step; before the first step the scans and the truth of time 0."""

    def step(self, action: Any) -> LiveStep:
        """Drive the ego by an action of highway-env until the next decision, ``1 / policy_frequency`` s later.

        Raises:
            InputError: the episode is over, or ``action_space`` has no such action.
        """
        if self.latest.terminated or self.latest.truncated:
            raise InputError("the episode is over; begin another with tb.live(scenario)")
        values, space = np.asarray(action), self.action_space
        if not np.can_cast(values.dtype, space.dtype, "same_kind") or values.astype(space.dtype) not in space:
            raise InputError(f"{action!r} is not in {space}", key="action")
        self.latest = self._observe(*self._traffic.step(values))
        return self.latest

    def _observe(self, reward: float, terminated: bool, truncated: bool) -> LiveStep:
        truth = self._traffic.truth()
        truncated = truncated or bool(truth.time[-1] >= self._traffic.times[-1])
        return LiveStep(self._sensing.arrived(truth), truth, reward, terminated, truncated)


def live(scenario: Scenario | Named) -> LiveEpisode:
    """Begin an episode of a highway-env scenario whose ego vehicle, which carries the sensors, the caller drives.

    Args:
        scenario: a scenario, or an argument of :func:`load`; only its first scene is used. Its ``trackers``,
            ``truth.ego`` and ``truth.targets`` are not used: all other vehicles are objects.

    Raises:
        InputError: something is wrong in the scenario, its truth is not highway-env, or its sensors stand still.
    """
    truth = (loaded := loaded_scenario(scenario)).config.truth
    try:
        if not isinstance(truth, HighwayOptions) or truth.observer != "ego":
            problem = "the observer must be the ego of highway-env; write source: highway-env, observer: ego"
            raise InputError(problem, key="truth")
        return LiveEpisode(loaded, truth.scenes()[0])
    except InputError as error:
        raise loaded.locate(error) from None
