"""Drivers who vary: their processes in closed form, what they do on the road, and their limits."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.base.types import Truth
from trackbench.scenario import load_scenario
from trackbench.truth import highway
from trackbench.truth.drivers import (
    HUMAN,
    Drivers,
    GaussMarkov,
    Traffic,
    bend_speeds,
)
from trackbench.truth.environment import Recorder
from trackbench.truth.sources import HighwayTruth

DT = 0.05
#: No effect at all; each test below has its own.
UNVARIED = Drivers(
    acceleration_rms_mps2=0.0,
    wander_m=0.0,
    reaction_s=0.0,
    speed_spread=0.0,
    headway_s=(1.5, 1.5),
    calm_from_mps=math.inf,
    cornering_mps2=math.inf,
    grip_mps2=math.inf,
    jerk_mps3=math.inf,
)


class Scene:
    """An environment of some cars in one lane, the first behind, each with a driver."""

    def __init__(self, drivers: Drivers, *places: float, speed: float = 20.0, rate_hz: int = 20) -> None:
        self.road = Road(RoadNetwork.straight_road_network(1, length=1e5, nodes_str=("a", "b")))
        self.cars = [IDMVehicle.make_on_lane(self.road, ("a", "b", 0), at, speed=speed) for at in places]
        self.road.vehicles.extend(self.cars)
        self.steps = 0
        config = HighwayTruth(env="highway-v0", seed=4, duration_s=1, rate_hz=rate_hz)
        control = Traffic(self, drivers, config)
        for number, car in enumerate(self.cars):
            car.target_speed = speed
            control(car, number)

    def drive(self, steps: int) -> None:
        for _ in range(steps):
            self.road.act()
            self.road.step(DT)


@pytest.mark.parametrize("dt", [0.02, 0.5, 3.0])
def test_a_process_has_its_deviation_and_correlation_at_any_step(dt: float) -> None:
    members, sigma, time_s = 20_000, 0.7, 2.0
    random = np.random.default_rng(1)
    values = np.empty((4, members))
    for member in range(members):
        process = GaussMarkov(sigma, time_s, dt, random)
        values[:, member] = [process.value, process.advance(), process.advance(), process.advance()]
    error = 4.0 / math.sqrt(members)
    assert values.std(axis=1) == pytest.approx(sigma, rel=error)
    for lag in (1, 2, 3):
        correlation = float(np.mean(values[0] * values[lag])) / sigma**2
        assert correlation == pytest.approx(math.exp(-lag * dt / time_s), abs=error * math.sqrt(2))


def test_the_draws_of_the_environment_are_left_alone() -> None:
    config = HighwayTruth(env="highway-v0", seed=1, duration_s=1, rate_hz=10, drivers="human")
    env = highway.prepare_env(config)
    before = env.np_random.bit_generator.state
    recorder = Recorder(env, highway.control_of(env, config))
    for _ in range(3):
        env.step(highway._neutral_action(env.action_type))
    assert len(recorder.frames) == 30
    assert env.np_random.bit_generator.state == before


def test_a_driver_reacts_to_the_car_ahead_when_it_has_seen_it() -> None:
    delays = []
    for reaction_s in (0.0, 0.5):
        pair = [Scene(replace(UNVARIED, reaction_s=reaction_s), 0.0, 70.0) for _ in range(2)]
        pair[1].cars[1].target_speed = 5.0
        accelerations = [[scene.drive(1) or scene.cars[0].action["acceleration"] for _ in range(40)] for scene in pair]
        delays.append(int(np.argmax(np.not_equal(*accelerations))))
    assert delays == [1, 1 + round(0.5 / DT)]


def test_the_driver_behind_reacts_to_one_who_varies() -> None:
    scene = Scene(replace(UNVARIED, acceleration_rms_mps2=0.5, acceleration_time_s=3), 0.0, 40.0)
    scene.cars[0].driver.acceleration = GaussMarkov(0.0, 1.0, DT, np.random.default_rng())
    scene.cars[0].target_speed = 30.0
    scene.drive(200)
    behind, ahead = np.array([scene.drive(1) or [car.speed for car in scene.cars] for _ in range(2000)]).T
    assert ahead.std() > 0.2
    assert max(np.corrcoef(behind[lag:], ahead[: len(ahead) - lag])[0, 1] for lag in range(0, 60, 5)) > 0.8


def test_a_driver_steers_to_the_side_of_the_lane_that_it_wants() -> None:
    scene = Scene(UNVARIED, 0.0)
    scene.cars[0].driver.wander = GaussMarkov(1e-12, 1.0, DT, np.random.default_rng())
    scene.cars[0].driver.wander.advance = lambda: 0.4
    scene.drive(400)
    assert scene.cars[0].position[1] == pytest.approx(0.4, abs=1e-3)


@pytest.mark.parametrize("time_s", [0.5, 2.0])
def test_a_car_wanders_across_its_lane_by_what_is_stated(time_s: float) -> None:
    scene = Scene(replace(UNVARIED, wander_m=0.2, wander_time_s=time_s), 0.0, 1e4, 2e4)
    scene.drive(200)
    side = np.array([scene.drive(1) or [car.position[1] for car in scene.cars] for _ in range(8_000)])
    # 1200 s, of which deviations over 3 s are as good as independent.
    assert side.std() == pytest.approx(0.2, rel=3.0 / math.sqrt(2 * 1200 / 3))
    assert abs(side.mean()) < 3.0 * 0.2 / math.sqrt(1200 / 3)


def test_each_driver_has_its_speed_and_headway() -> None:
    scene = Scene(replace(UNVARIED, speed_spread=0.1, headway_s=(1.0, 2.0)), 0.0, 1e4, 2e4, 3e4)
    scene.drive(1200)
    speeds = [car.speed for car in scene.cars]
    assert speeds == pytest.approx([20.0 * car.driver.speed_factor for car in scene.cars], rel=1e-3)
    assert len(set(speeds)) == 4
    assert all(1.0 <= car.TIME_WANTED <= 2.0 for car in scene.cars)
    assert IDMVehicle.TIME_WANTED == 1.5


def test_below_the_speed_of_its_full_size_the_acceleration_is_in_proportion_to_the_speed() -> None:
    def speeds(size: float, full_mps: float) -> list[float]:
        scene = Scene(
            replace(UNVARIED, acceleration_rms_mps2=size, acceleration_full_mps=full_mps), 0.0, 1e4, speed=5.0
        )
        scene.drive(2)
        return [car.speed for car in scene.cars]

    assert speeds(0.4, 20.0) == pytest.approx(speeds(0.1, 5.0), rel=1e-3)
    assert speeds(0.4, 20.0) != speeds(0.4, 5.0)
    assert speeds(0.4, 3.0) == speeds(0.4, 2.0)


@pytest.mark.parametrize("speed", [20.0, 30.0])
def test_a_calm_driver_brakes_as_much_as_is_needed_and_little_more(speed: float) -> None:
    """Behind a car that is 10 m/s slower, 45 m ahead: the model brakes at 6 m/s^2, and nobody is hit."""
    hardest = {}
    for calm_from_mps in (math.inf, 12.0):
        scene = Scene(replace(UNVARIED, calm_from_mps=calm_from_mps), 0.0, 45.0, speed=speed)
        behind, ahead = scene.cars
        ahead.speed = ahead.target_speed = speed - 10.0
        speeds = []
        for _ in range(1000):
            scene.drive(1)
            speeds.append(behind.speed)
            assert ahead.position[0] - behind.position[0] > 5.0
        hardest[calm_from_mps] = -np.diff(speeds).min() / DT
        assert behind.speed == pytest.approx(speed - 10.0, abs=0.5)
    # It needs 100 / (2 * 40) = 1.25 m/s^2 at first.
    assert hardest[math.inf] > 5.0
    assert 1.25 < hardest[12.0] < 3.5


@pytest.mark.parametrize("gap_m", [35.0, 45.0, 60.0])
def test_a_calm_driver_stops_behind_a_car_that_brakes_hard(gap_m: float) -> None:
    """From 25 m/s to rest, with a reaction of 0.7 s."""
    scene = Scene(replace(UNVARIED, calm_from_mps=12.0, reaction_s=0.7), 0.0, gap_m, speed=25.0)
    behind, ahead = scene.cars
    ahead.target_speed = 0.0
    for _ in range(400):
        scene.drive(1)
        assert ahead.position[0] - behind.position[0] > 5.0
    assert ahead.speed == pytest.approx(0.0, abs=0.1)
    assert behind.speed == pytest.approx(0.0, abs=0.5)


def test_below_its_speed_a_calm_driver_is_that_of_the_model() -> None:
    places = []
    for calm_from_mps in (math.inf, 12.0):
        scene = Scene(replace(UNVARIED, calm_from_mps=calm_from_mps), 0.0, 30.0, speed=11.0)
        scene.cars[1].target_speed = 4.0
        scene.drive(200)
        places.append([car.position[0] for car in scene.cars])
    assert places[0] == places[1]


def test_a_car_that_stands_keeps_standing() -> None:
    scene = Scene(replace(UNVARIED, acceleration_rms_mps2=2.0), 0.0, speed=5.0)
    scene.cars[0].target_speed = 0.0
    scene.drive(200)
    speeds = [scene.drive(1) or scene.cars[0].speed for _ in range(200)]
    assert min(speeds) >= 0.0
    assert max(speeds) < 0.05


def changed(name: str, **options: Any) -> HighwayTruth:
    truth = load_scenario(name).config.truth
    assert isinstance(truth, HighwayTruth)
    return HighwayTruth.model_validate({**truth.model_dump(), "targets": "all", **options})


def peak(truth: Truth) -> float:
    """Largest change of the velocity vector over the duration of a step, m/s^2."""
    return float(truth.audit["velocity_jumps"]["peak_acceleration_mps2"])


@pytest.mark.parametrize("seed", [2, 3])
def test_tyres_hold_in_the_roundabout_where_those_of_steady_drivers_do_not(seed: int) -> None:
    human = highway.simulate(changed("roundabout", drivers="human", seed=seed, steering_rate_degps=None))
    assert peak(human) < HUMAN.grip_mps2 + 0.05
    assert human.source["drivers"] == "human"
    steady = highway.simulate(changed("roundabout", seed=seed))
    assert peak(steady) > 12
    assert "drivers" not in steady.source


@pytest.mark.parametrize(("speed", "target"), [(0.0, 0.0), (12.0, 20.0), (30.0, 20.0), (20.0, 60.0)])
def test_the_free_road_is_that_of_the_model(speed: float, target: float) -> None:
    scene = Scene(UNVARIED, 0.0)
    car = scene.cars[0]
    car.speed, car.target_speed = speed, target
    assert car.free_road_acceleration() == pytest.approx(car.acceleration(car, None), rel=1e-12)


def test_no_acceleration_jumps() -> None:
    scene = Scene(replace(UNVARIED, jerk_mps3=4), 0.0, 30.0)
    scene.cars[1].target_speed = 5.0
    accelerations = [scene.drive(1) or [car.action["acceleration"] for car in scene.cars] for _ in range(400)]
    jerk = np.abs(np.diff(accelerations, axis=0, prepend=0.0)) / DT
    assert jerk.max() == pytest.approx(4.0, rel=1e-9)


def test_bends_are_as_fast_as_their_radius_allows() -> None:
    network = highway.prepare_env(HighwayTruth(env="roundabout-v1", duration_s=1, rate_hz=20)).road.network
    speeds = bend_speeds(network, 3.0)
    assert speeds["se", "ex", 0] == pytest.approx(math.sqrt(3.0 * network.get_lane(("se", "ex", 0)).radius), rel=1e-3)
    assert ("ser", "ses", 0) not in speeds


@pytest.mark.parametrize(
    ("truth", "message"),
    [
        ({"env": "highway-v0", "drivers": "humane"}, "human"),
        ({"env": "highway-v0", "drivers": {"wander_m": 0.1}}, "steady"),
        ({"env": "parking-v0", "ego": "idle", "drivers": "human"}, "has no driver who follows a lane; write steady"),
    ],
)
def test_mistakes_are_named(truth: dict[str, Any], message: str) -> None:
    content = {
        "name": "x",
        "truth": {"source": "highway-env", "duration_s": 1, "rate_hz": 20, **truth},
        "score": {"settle_s": 0.2},
        "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.1}},
        "trackers": {"raw": {"use": "raw"}},
    }
    with pytest.raises(InputError, match=message):
        tb.truth(content)
