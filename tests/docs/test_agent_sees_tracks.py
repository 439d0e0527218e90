"""The example of an agent that sees tracks keeps Gymnasium's rules, and its observations err as sensors do."""

from __future__ import annotations

import importlib.util
import warnings
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from tests.support.places import DOCS

FILE = DOCS / "examples" / "agent_sees_tracks.py"
LOOSE = {"truth.config.vehicles_density": 1, "truth.duration_s": 10}
#: Most decisions are made without a new scan, and what arrives is old.
SLOW = {
    "sensors.front_radar.rate_hz": 5,
    "sensors.front_radar.latency_s": 0.1,
    "sensors.roof_lidar.rate_hz": 2,
    "sensors.roof_lidar.phase_s": 0.25,
    "truth.config.policy_frequency": 10,
    "truth.duration_s": 5,
}


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("agent_sees_tracks", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("scenario", ["traffic/dense_highway", "traffic/intersection"])
def test_gymnasium_finds_nothing_to_complain_of(example: ModuleType, scenario: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # highway-env draws no picture of what the agent sees.
        check_env(example.TracksEnv(scenario, changes={"truth.observer": "ego"}), skip_render_check=True)


def drive(example: ModuleType, seed: int, changes: dict[str, Any], **options: Any) -> tuple[list[Any], list[Any], Any]:
    """The observations of an episode of the example's rule, the others' positions at each, and the environment."""
    env = example.TracksEnv(changes={**LOOSE, **changes}, **options)
    observation, _ = env.reset(seed=seed)
    observations, positions, ended = [], [], False
    while not ended:
        observation, _, terminated, truncated, _ = env.step(example.keep_a_gap(observation))
        truth, ended = env.truth, terminated or truncated
        there, ego = truth.alive[-1], truth.observer
        observations.append(observation)
        positions.append(np.stack([truth.px[-1, there, 0] - ego.px[-1], truth.py[-1, there, 0] - ego.py[-1]]))
    return observations, positions, env


@pytest.mark.parametrize(("changes", "largest_m"), [({}, 0.6), (SLOW, 0.8)], ids=["fast", "slow"])
def test_tracks_differ_from_the_truth_as_far_as_they_say(
    example: ModuleType, changes: dict[str, Any], largest_m: float
) -> None:
    errors, stated, tracks = [], [], 0
    for seed in (1, 2):
        observations, positions, env = drive(example, seed, changes)
        assert env.truth.time[-1] == pytest.approx({**LOOSE, **changes}["truth.duration_s"])
        for observation, position in zip(observations, positions, strict=True):
            for row in observation[1:][observation[1:, 0] > 0]:
                differences = position - row[1:3, None]
                nearest = np.argmin(np.hypot(*differences))
                tracks += 1
                if np.hypot(*differences[:, nearest]) < 3:
                    errors.append(differences[:, nearest])
                    stated.append(row[5:7])
    assert len(errors) > 0.9 * tracks > 100
    # The radar measures ranges to 0.3 m and bearings to 0.5 degrees, 0.6 m at 70 m, the lidar positions to 0.15 m.
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert ((rms > 0.03) & (rms < largest_m)).all(), rms
    normalised = np.mean(np.square(np.divide(errors, stated)), axis=0)
    assert ((normalised > 0.5) & (normalised < 2)).all(), normalised


def test_the_ego_vehicle_and_the_rows_without_a_track(example: ModuleType) -> None:
    observations, _, env = drive(example, 1, {}, rows=40)
    ego = env.truth.observer
    assert observations[-1][0] == pytest.approx([1, 0, ego.py[-1], ego.vx[-1], ego.vy[-1], 0, 0], abs=1e-4)
    assert not observations[-1][observations[-1][:, 0] == 0].any()
    distance = np.hypot(*observations[-1][1:, 1:3].T)[observations[-1][1:, 0] > 0]
    assert len(distance) > 5
    assert (np.diff(distance) >= 0).all()
