"""Ground truth from the installed highway-env."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from highway_env.vehicle.behavior import IDMVehicle

from trackbench.base.errors import InputError
from trackbench.base.types import Truth
from trackbench.base.units import wrap_angle
from trackbench.truth.highway import list_envs, simulate
from trackbench.truth.sources import HighwayTruth

ROADSIDE = {"x": -32, "y": -32, "yaw_deg": 45}


def configured(env: str, **keys: Any) -> HighwayTruth:
    values = {"source": "highway-env", "env": env, "seed": 3, "duration_s": 2, "rate_hz": 20, **keys}
    return HighwayTruth.model_validate(values)


def velocity_error(truth: Truth) -> float:
    """Largest difference of a velocity from the displacement between the instants before and after, m/s."""
    px, py = ((position[2:] - position[:-2]) / (2 * truth.time[1]) for position in (truth.px, truth.py))
    gap = np.hypot(px - truth.vx[1:-1], py - truth.vy[1:-1])
    return float(gap[(truth.alive[:-2] & truth.alive[2:])[..., None]].max())


@pytest.mark.parametrize("env", list_envs())
def test_every_environment_gives_a_consistent_truth(env: str) -> None:
    alone = env.startswith(("parking", "lane-keeping"))
    truth = simulate(configured(env, duration_s=1, **({"ego": "idle", "observer": ROADSIDE} if alone else {})))
    steps, objects, runs = truth.px.shape
    assert (steps, runs) == (21, 1)
    assert objects == len(truth.ids) > 0
    assert truth.alive.any(axis=0).all()
    assert (truth.speed >= 0).all()
    assert velocity_error(truth) < 1e-9
    assert truth.roads
    for name in ("px", "py", "heading", "course", "speed", "acceleration", "yaw_rate"):
        assert np.isfinite(getattr(truth, name)).all(), name


def test_slip_angle_matters_on_a_roundabout() -> None:
    truth = simulate(configured("roundabout-v1", seed=0, duration_s=6, observer=ROADSIDE))
    assert np.abs(wrap_angle(truth.course - truth.heading)).max() > 0.1
    assert truth.audit["velocity_error_after"]["max_mps"] < 1e-9


def test_frame_is_right_handed_seen_from_above() -> None:
    """Traffic keeps right in highway-env: it goes round counter-clockwise, and its own lane has the lower y."""
    around = simulate(configured("roundabout-v1", seed=0, duration_s=6, observer=ROADSIDE))
    inside = around.alive[..., None] & (np.hypot(around.px, around.py) < 25)
    assert (around.px * around.vy - around.py * around.vx)[inside].mean() > 0
    oncoming = simulate(configured("two-way-v0"))
    towards = oncoming.vx[0, :, 0] < 0
    assert oncoming.py[0, towards, 0].min() > oncoming.py[0, ~towards, 0].max()


def test_straight_traffic_needs_no_repair() -> None:
    assert simulate(configured("two-way-v0")).audit["verdict"] == "consistent"


def test_vehicles_are_followed_by_identity_as_they_come_and_go() -> None:
    far = {"destination": "o3"}
    truth = simulate(configured("intersection-v2", seed=14, duration_s=24, rate_hz=10, config=far, observer=ROADSIDE))
    first, last = truth.alive.argmax(axis=0), truth.alive[::-1].argmax(axis=0)
    assert (first > 0).any(), "none appears"
    assert (last > 0).any(), "none leaves"
    for i in range(len(truth.ids)):
        alive = np.flatnonzero(truth.alive[:, i])
        assert len(alive) == alive[-1] - alive[0] + 1, "a vehicle comes back"
        step = np.hypot(np.diff(truth.px[alive, i, 0]), np.diff(truth.py[alive, i, 0]))
        assert step.max(initial=0.0) < 2.0, "two vehicles are taken for one"
    assert truth.ids[0] == "ego"
    numbers = [int(name[1:]) for name in truth.ids[1:]]
    assert numbers == sorted(numbers)
    assert (np.diff(first[1:]) >= 0).all(), "names do not follow the order of appearance"


def test_same_seed_same_truth_whatever_ran_before() -> None:
    config = configured("highway-v0", config={"vehicles_count": 10})
    before = simulate(config)
    driver = IDMVehicle.COMFORT_ACC_MAX, IDMVehicle.COMFORT_ACC_MIN, IDMVehicle.DISTANCE_WANTED
    simulate(configured("intersection-v2", duration_s=1))
    assert driver == (IDMVehicle.COMFORT_ACC_MAX, IDMVehicle.COMFORT_ACC_MIN, IDMVehicle.DISTANCE_WANTED)
    after = simulate(config)
    np.testing.assert_array_equal(before.px, after.px)
    np.testing.assert_array_equal(before.course, after.course)
    other = simulate(configured("highway-v0", seed=4, config={"vehicles_count": 10}))
    assert not np.array_equal(before.px, other.px)


def test_time_is_counted_in_simulation_steps() -> None:
    truth = simulate(configured("highway-v0", rate_hz=15, config={"policy_frequency": 5, "vehicles_count": 3}))
    np.testing.assert_allclose(truth.time, np.arange(31) / 15)
    with pytest.raises(
        InputError, match=r"4 does not divide truth\.rate_hz \(15\); write one of 1, 3, 5, 15"
    ) as caught:
        simulate(configured("highway-v0", rate_hz=15, config={"policy_frequency": 4}))
    assert caught.value.key == "truth.config.policy_frequency"


def test_observer_is_the_ego_or_a_point() -> None:
    riding = simulate(configured("highway-v0", config={"vehicles_count": 5}))
    beside = simulate(configured("highway-v0", config={"vehicles_count": 5}, observer=ROADSIDE))
    assert "ego" not in riding.ids
    assert beside.ids == ("ego", *riding.ids)
    np.testing.assert_array_equal(beside.px[:, 0, 0], riding.observer.px)
    assert riding.observer.length == 5.0
    assert (beside.observer.px == -32).all()
    np.testing.assert_allclose(beside.observer.yaw, np.pi / 4)
    assert not beside.observer.vx.any()


def test_targets_can_be_chosen() -> None:
    everyone = simulate(configured("highway-v0", config={"vehicles_count": 8}))
    near = simulate(configured("highway-v0", config={"vehicles_count": 8}, targets={"nearest": 3}))
    gap = np.hypot(
        everyone.px[..., 0] - everyone.observer.px[:, None], everyone.py[..., 0] - everyone.observer.py[:, None]
    )
    assert set(near.ids) == {everyone.ids[i] for i in np.argsort(gap.min(axis=0))[:3]}
    named = simulate(configured("highway-v0", config={"vehicles_count": 8}, targets={"ids": ["v7", "v2"]}))
    assert named.ids == ("v2", "v7")
    np.testing.assert_array_equal(named.px[:, 0], everyone.px[:, everyone.ids.index("v2")])
    with pytest.raises(InputError, match="no vehicle 'v77' in this scene; did you mean 'v7'") as caught:
        simulate(configured("highway-v0", config={"vehicles_count": 8}, targets={"ids": ["v77"]}))
    assert caught.value.key == "truth.targets.ids"
    with pytest.raises(InputError, match="no vehicle to track"):
        simulate(configured("highway-v0", config={"vehicles_count": 0}))


def test_idm_drives_the_ego_as_the_others() -> None:
    """Idle keeps speed and lane and runs into the traffic, the driver model slows down or overtakes."""
    idle = simulate(configured("two-way-v0", duration_s=8, ego="idle"))
    idm = simulate(configured("two-way-v0", duration_s=8))
    assert idle.audit["ended_early"]["reason"] == "the observer collides or jumps"
    assert idle.time[-1] < 8
    assert idm.audit["ended_early"] is None
    assert idm.time[-1] == 8
    assert idm.observer.vx.min() < idle.observer.vx.min() - 3


def test_idle_is_neutral_where_actions_are_continuous() -> None:
    action = {"type": "ContinuousAction", "acceleration_range": [-5, 3], "steering_range": [-0.2, 0.6]}
    truth = simulate(configured("highway-v0", ego="idle", config={"action": action, "vehicles_count": 3}))
    np.testing.assert_allclose(truth.observer.vx, 25.0, atol=1e-6)
    np.testing.assert_allclose(truth.observer.vy, 0.0, atol=1e-6)


def test_truth_ends_where_the_environment_ends() -> None:
    truth = simulate(configured("highway-v0", duration_s=10, config={"duration": 4, "vehicles_count": 3}))
    assert truth.audit["ended_early"] == {"time_s": pytest.approx(3.95), "reason": "the environment's time limit"}
    unlimited = simulate(configured("roundabout-v1", duration_s=14, observer=ROADSIDE))
    assert unlimited.time[-1] == pytest.approx(14)


@pytest.mark.parametrize(
    ("env", "keys", "key", "message"),
    [
        ("hihgway-v0", {}, "truth.env", "unknown highway-env id 'hihgway-v0'; did you mean 'highway-v0'"),
        ("highway-v0", {"config": {"lane_count": 3}}, "truth.config.lane_count", "did you mean 'lanes_count'"),
        (
            "racetrack-v1",
            {"rate_hz": 12},
            "truth.config.policy_frequency",
            "5 does not divide .* write one of 1, 2, 3, 4, 6, 12",
        ),
        ("highway-v0", {"config": {"simulation_frequency": 15}}, "truth.config.simulation_frequency", "rate_hz"),
        ("highway-v0", {"config": {"initial_lane_id": 9}}, "truth.config", "cannot be set up"),
        (
            "highway-v0",
            {"config": {"other_vehicles_type": "highway_env.vehicle.behavior.Nobody"}},
            "truth.config",
            "has no attribute 'Nobody'",
        ),
        ("racetrack-oval-v1", {"config": {"length": 0}}, "truth.config.length", "the seed does not determine"),
        ("parking-v0", {}, "truth.ego", "has no lanes to follow; write ego: idle"),
    ],
)
def test_mistakes_are_found_without_simulating(env: str, keys: dict[str, Any], key: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        configured(env, **keys).check(folder=Path())
    assert caught.value.key == key
