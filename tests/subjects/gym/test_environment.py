"""The environment keeps Gymnasium's rules, repeats itself, and shows the truth as highway-env does."""

from __future__ import annotations

import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import trackbench.gym
from trackbench import InputError, TrackbenchError

SHORT = {"duration": 4, "policy_frequency": 2, "vehicles_count": 8, "simulation_frequency": 10}
SENSORS = {
    "radar": {"type": "radar", "rate_hz": 10, "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5,
              "range_rate_sigma_mps": 0.1, "fov_deg": 360, "max_range_m": 150, "clutter": {"per_scan": 2}},
}  # fmt: skip
IDLE = 1
KINEMATICS = ("presence", "x", "y", "vx", "vy")


def make(**options: Any) -> Any:
    options = {"env": "highway-v0", "config": SHORT, "sensors": SENSORS, "tracker": "gnn", **options}
    return gymnasium.make(trackbench.gym.ID, **options)


def episode(env: Any, seed: int | None, actions: Any = None) -> tuple[list[Any], dict[str, Any]]:
    """Every observation of an episode, and what was said last."""
    observation, info = env.reset(seed=seed)
    observations, ended, number = [observation], False, 0
    while not ended:
        action = IDLE if actions is None else actions[number]
        observation, _, terminated, truncated, info = env.step(action)
        assert observation in env.observation_space
        observations.append(observation)
        ended, number = terminated or truncated, number + 1
    return observations, info


@pytest.mark.parametrize(
    ("name", "tracker"),
    [
        ("highway-v0", "gnn"),
        ("highway-v0", "detections"),
        ("merge-v0", "truth"),
        ("racetrack-v0", "gnn"),
        ("parking-v0", "gnn"),
    ],
)
def test_gymnasium_finds_nothing_to_complain_of(name: str, tracker: str) -> None:
    config = {"simulation_frequency": 10, "policy_frequency": 5}
    env = make(env=name, tracker=tracker, config=config, render_mode="rgb_array", disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
    env.close()


def test_several_at_once_are_the_single_ones() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vector = gymnasium.make_vec(
            trackbench.gym.ID, num_envs=2, env="highway-v0", config=SHORT, sensors=SENSORS, tracker="gnn"
        )
        first, _ = vector.reset(seed=[3, 4])
        assert first in vector.observation_space
        for _ in range(3):
            observations, _, _, _, infos = vector.step(np.array([IDLE, IDLE]))
            assert observations in vector.observation_space
    for place, seed in enumerate((3, 4)):
        env = make()
        env.reset(seed=seed)
        for _ in range(3):
            observation, _, _, _, info = env.step(IDLE)
        assert np.array_equal(observation, observations[place])
        assert infos["drive"]["reward"][place] == info["drive"]["reward"]
        env.close()
    vector.close()


def test_it_is_made_by_the_name_of_the_module_alone() -> None:
    program = (
        "import gymnasium\n"
        f"env = gymnasium.make('trackbench.gym:{trackbench.gym.ID}', env='highway-v0', tracker='gnn')\n"
        "print(env.observation_space.shape)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "(5, 10)", done.stderr


def test_a_seed_repeats_an_episode_and_what_follows_without_one() -> None:
    env, again = make(), make()
    runs = [[episode(each, seed)[0] for seed in (5, None, 6)] for each in (env, again)]
    for one, other in zip(*runs, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    assert not np.array_equal(runs[0][0][-1], runs[0][1][-1])
    env.close()
    again.close()


def test_trackers_of_one_seed_see_the_same_measurements() -> None:
    """Where the actions are the same."""
    scans = {}
    for tracker in ("gnn", "jipda", "detections"):
        env = make(tracker=tracker)
        sensed = env.unwrapped
        taken: list[Any] = []
        perceive = sensed._perception.take
        sensed._perception.take = lambda items, truth, taken=taken, perceive=perceive: (
            taken.extend(item.scan.measurement for item in items) or perceive(items, truth)
        )
        episode(env, 7)
        scans[tracker] = taken
        env.close()
    reference = scans["gnn"]
    assert len(reference) > 30
    for taken in scans.values():
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(reference, taken, strict=True))


def test_the_truth_is_the_observation_of_highway_env() -> None:
    """Of as many vehicles as there are; but for the velocity, which highway-env states without the slip angle."""
    own = {"type": "Kinematics", "vehicles_count": 9, "see_behind": True, "features": list(KINEMATICS)}
    env = make(tracker="truth", rows=9, features=KINEMATICS, config={**SHORT, "duration": 8})
    actions = [0, 1, 2, 1, 3, 4, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1]
    env.reset(seed=1)
    highway = env.unwrapped.highway
    from highway_env.envs.common.observation import observation_factory

    for action in actions:
        observation, _, terminated, truncated, _ = env.step(action)
        wanted = observation_factory(highway, own)
        wanted.observer_vehicle = highway.vehicle
        wanted = wanted.observe()
        # The nearest first: highway-env measures along the lane.
        order = np.lexsort(observation[1:, 1:3].T), np.lexsort(wanted[1:, 1:3].T)
        assert np.abs(observation[0, :3] - wanted[0, :3]).max() < 1e-6
        assert np.abs(observation[1:][order[0], :3] - wanted[1:][order[1], :3]).max() < 1e-6
        # 2 m/s of 80: the slip angle, and half a step of acceleration.
        assert np.abs(observation[1:][order[0], 3:] - wanted[1:][order[1], 3:]).max() < 0.06
        if terminated or truncated:
            break
    env.close()


def test_tracks_come_near_to_the_truth() -> None:
    env = make(normalised=False, rows=6)
    observations, _ = episode(env, 2)
    layout, highway = env.unwrapped.layout, env.unwrapped.highway
    rows = layout.from_array(observations[-1])
    there = rows["presence"][1:] > 0
    assert there.sum() >= 4
    ego = highway.vehicle
    others = [v.position - ego.position for v in highway.road.vehicles if v is not ego]
    for x, y, deviation in zip(rows["x"][1:][there], rows["y"][1:][there], rows["std_x"][1:][there], strict=True):
        assert min(np.hypot(*(other - (x, y))) for other in others) < 2.0
        assert 0.0 < deviation < 2.0
    env.close()


def test_what_is_said_of_an_episode() -> None:
    env = make(tracker="truth", config={**SHORT, "duration": 20, "vehicles_density": 2})
    observations, info = episode(env, 4, [3] * 100)
    drive = info["drive"]
    assert drive["crashed"] is True
    assert drive["min_time_gap_s"] == 0.0
    assert drive["steps"] == len(observations) - 1
    assert drive["time_s"] == pytest.approx(drive["steps"] / 2)
    assert 15.0 < drive["mean_speed_mps"] < 40.0
    # The counts begin anew.
    _, info = env.reset(seed=4)
    assert info["drive"] == {**drive, "crashed": False, "min_time_gap_s": np.inf, "mean_speed_mps": info["speed"],
                             "reward": 0.0, "time_s": 0.0, "steps": 0}  # fmt: skip
    env.close()


def test_the_reward_is_the_sum_of_what_was_given() -> None:
    env = make()
    env.reset(seed=1)
    total = sum(env.step(IDLE)[1] for _ in range(4))
    assert env.step(IDLE)[4]["drive"]["reward"] > total
    env.close()


def test_an_environment_without_a_limit_of_time_ends_with_the_scenario() -> None:
    env = make(env="merge-v0", config={"simulation_frequency": 10, "policy_frequency": 5}, tracker="truth")
    assert "duration" not in env.unwrapped.highway.config
    assert env.unwrapped.scenario.truth.duration_s == 60
    env.close()


def test_a_picture_of_the_truth_is_drawn() -> None:
    env = make(render_mode="rgb_array")
    env.reset(seed=1)
    picture = env.render()
    assert picture.shape == (150, 600, 3)
    assert picture.std() > 0
    env.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"env": "highway-v9"}, "unknown highway-env id 'highway-v9'"),
        ({"tracker": "gmn"}, "no tracker 'gmn'; did you mean"),
        ({"tracker": "nowhere:Nothing"}, "tracker.use: cannot import"),
        ({"tracker": {"filter": "ekf"}}, "tracker.motion: missing"),
        ({"sensors": {}}, "sensors: missing"),
        ({"sensors": [1]}, "sensors: must be a mapping, not [1]"),
        ({"tracker": 5}, "tracker: must be a mapping, not 5"),
        ({"features": "x"}, "features: must be a list of names"),
        ({"sensors": {"radar": {"type": "radra"}}}, "sensors.radar.type"),
        ({"config": {"vehicle_count": 3}}, "vehicles_count"),
        ({"config": {"policy_frequency": 7}}, "config.policy_frequency: 7 does not divide"),
        ({"config": {"action": {"type": "MultiAgentAction"}}}, "action"),
        ({"scenario": "no_such"}, "no_such"),
        ({"scenario": "traffic/cut_in", "env": None}, "is not highway-env; give env"),
        ({"rows": 1}, "rows: must be a whole number from 2"),
        ({"features": ["x", "presance"]}, "unknown feature 'presance'; did you mean"),
        ({"features": ["x", "x"]}, "name each feature once"),
    ],
)
def test_bad_input_is_said_in_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        make(**options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


PLUG_IN = """\
import os
import numpy as np
from trackbench import Tracks

class Mine:
    def __init__(self, fail_at=1e9):
        self.fail_at = fail_at

    def step(self, state, scan):
        if scan.time > self.fail_at:
            os._exit(3)
        ids = np.arange(scan.measurement.shape[1])
        mean = np.zeros((4, len(ids)))
        mean[0] = os.getpid()
        return state, Tracks(ids, mean, np.eye(4)[:, :, None] * np.ones(len(ids)))
"""


def test_a_tracker_of_ones_own_works_in_its_process(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_mine.py").write_text(PLUG_IN)
    monkeypatch.chdir(tmp_path)
    import os

    env = make(tracker="my_mine:Mine")
    episode(env, 1)
    assert env.unwrapped.tracks.mean[0, 0] not in (0, os.getpid())
    # Tracks that state no probability of existence.
    assert env.unwrapped.layout.from_array(env.reset(seed=1)[0])["existence"][1] == -1.0
    env.close()
    env = make(tracker={"use": "my_mine:Mine", "options": {"fail_at": 1.0}})
    with pytest.raises(
        TrackbenchError, match="the tracker my_mine:Mine failed: its process ended itself, with status 3"
    ):
        episode(env, 1)
    env.close()
