"""``trackbench/Tracked-v0``: highway-env, whose observation is what a tracker makes of noisy sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np

from trackbench.api.scenario import Named
from trackbench.base.errors import InputError
from trackbench.base.types import Array, Tracks
from trackbench.driving.isolation import Isolation
from trackbench.subjects.gym.layout import layout_of
from trackbench.subjects.gym.perception import BareDetections, KnownTruth, Perception, Tracked
from trackbench.subjects.gym.sensing import EpisodeSensing
from trackbench.subjects.gym.setting import DETECTIONS, TRACKER, TRUTH, asked_errors, setting_of
from trackbench.truth.config import HighwayOptions
from trackbench.truth.driven import DrivenTraffic

RENDER_MODES = ("human", "rgb_array")


class TrackedEnv(gymnasium.Env[Any, Any]):
    """highway-env in which the agent sees tracks, detections or the truth.

    Args:
        env: id of highway-env, such as ``highway-v0``; that of the scenario unless given.
        config: changes of its configuration: action, policy_frequency, duration and so on.
        scenario: name, file or mapping of a scenario, whose truth, sensors and trackers hold unless stated here;
            ``traffic/dense_highway`` unless given.
        sensors: by name, as in a scenario.
        tracker: as in a scenario; or the name of one of the scenario's, a method of association such as ``jipda``,
            ``"package.module:Class"``, ``truth`` or ``detections``.
        rows: of the observation, with the ego's; as many as the environment's own unless given.
        features: of each row; ``layout.DEFAULT`` unless given.
        normalised: whether coordinates go from -1 to 1; else m and m/s.
        in_process: whether a tracker of one's own runs in this process.
        tracker_timeout: the longest that it may take for a scan, s.
        render_mode: as of highway-env.

    Raises:
        InputError: something is wrong in what is asked for.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 15}  # noqa: RUF012 (Gymnasium)

    def __init__(
        self,
        env: str | None = None,
        config: Mapping[str, Any] | None = None,
        scenario: Named | None = None,
        sensors: Mapping[str, Any] | None = None,
        tracker: str | Mapping[str, Any] = "gnn",
        rows: int | None = None,
        features: Sequence[str] | None = None,
        normalised: bool = True,
        in_process: bool = False,
        tracker_timeout: float = 300.0,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise InputError(f"must be one of {', '.join(RENDER_MODES)}, not {render_mode!r}", key="render_mode")
        self.render_mode = render_mode
        loaded = setting_of(env, config, scenario, sensors, tracker)
        self.scenario = loaded.config
        """What is simulated and sensed, and the tracker."""
        assert isinstance(self.scenario.truth, HighwayOptions)
        with asked_errors():
            self._drive = DrivenTraffic(self.scenario.truth, render_mode)
        self.highway = self._drive.env
        """The environment of highway-env, which has the truth."""
        self.layout = layout_of(self._drive.env, rows, features, normalised)
        """Of the observation."""
        self.observation_space = self.layout.space()
        self.action_space = self.highway.action_space
        self.metadata = {**self.metadata, "render_fps": self.highway.metadata.get("render_fps", 15)}
        self._perception = self._perceiving(tracker, loaded, Isolation(in_process, tracker_timeout))
        self._steps = self._episode = 0
        self._noise_seed: int | None = None
        self.tracks: Tracks
        """What was observed last, in the fixed frame: x ahead, y to the left."""

    def _perceiving(self, tracker: Any, loaded: Any, isolation: Isolation) -> Perception:
        if tracker == TRUTH:
            return KnownTruth()
        if tracker == DETECTIONS:
            return BareDetections()
        entry = loaded.config.trackers[TRACKER]
        name = tracker if isinstance(tracker, str) else getattr(entry, "use", TRACKER)
        if unguarded := isolation.missing(name, entry):
            gymnasium.logger.warn(unguarded)
        try:
            return Tracked(name, entry, loaded.folder, isolation)
        except InputError as error:
            raise InputError(error.message, key=f"tracker.{error.key or 'use'}") from error

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode. The same seed gives the same traffic and, for the same actions, the same measurements."""
        super().reset(seed=seed)
        if seed is None and self._noise_seed is None:
            # Drawn by Gymnasium, and asked for here.
            self.np_random  # noqa: B018
            seed = int(self.np_random_seed) % 2**32
        self._episode = self._episode + 1 if seed is None else 0
        self._noise_seed = self._noise_seed if seed is None else seed
        self._drive.reset(seed)
        truth = self.scenario.truth
        assert isinstance(truth, HighwayOptions)
        # The step after the last decision may end later.
        longest = 1.0 / self.highway.config["policy_frequency"] + self._time_limit
        time = np.arange(math.ceil(longest * truth.rate_hz) + 1) / truth.rate_hz
        assert self._noise_seed is not None
        self._sensing = EpisodeSensing(self.scenario.sensors, time, self._noise_seed, self.scenario.name, self._episode)
        self._perception.begin()
        self._return, self._steps, self._way = 0.0, 0, 0.0
        return self._observe(), self._info({})

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act until the next decision."""
        before = self._drive.now
        reward, terminated, truncated, info = self._drive.step(action)
        self._return += reward
        self._steps += 1
        self._way += float(info["speed"]) * (self._drive.now - before)
        truncated = truncated or self._drive.now >= self._time_limit - 1e-9
        return self._observe(), reward, terminated, truncated, self._info(info.get("rewards", {}))

    def render(self) -> Any:
        """As highway-env draws it: the truth."""
        return self.highway.render()

    def close(self) -> None:
        """End the tracker's process and the window."""
        self._perception.close()
        self.highway.close()

    def get_available_actions(self) -> Any:
        """As of highway-env, of discrete meta actions."""
        return self.highway.get_available_actions()

    @property
    def _time_limit(self) -> float:
        """The environment's own, else that of the scenario, s."""
        own = self._drive.time_limit
        return float(self.scenario.truth.duration_s if own is None else own)  # type: ignore[attr-defined]

    def _observe(self) -> Array:
        latest = self._drive.look()
        self.tracks = self._perception.take(self._sensing.arrived(latest), latest.truth)
        observation: Array = self.layout.observe(latest.truth.observer, self.tracks)
        return observation

    def _info(self, rewards: Mapping[str, Any]) -> dict[str, Any]:
        """What an episode is judged by, up to now."""
        vehicle, time = self.highway.vehicle, self._drive.now
        return {
            "crashed": bool(vehicle.crashed),
            "speed": float(vehicle.speed),
            "rewards": {name: float(value) for name, value in rewards.items()},
            "drive": {
                "crashed": bool(vehicle.crashed),
                "min_time_gap_s": self._drive.time_gap,
                "mean_speed_mps": self._way / time if time else float(vehicle.speed),
                "reward": self._return,
                "time_s": time,
                "steps": self._steps,
            },
        }
