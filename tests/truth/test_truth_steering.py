"""Vehicles whose front wheels turn at a finite rate: the rate holds, velocities do not jump, lanes are followed."""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from highway_env.road.lane import CircularLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle

from trackbench.base.types import Array, Truth
from trackbench.scenario import load_scenario
from trackbench.truth import highway, simulated
from trackbench.truth.environment import SteeredVehicle, steered
from trackbench.truth.sources import HighwayTruth

RATE = math.radians(30)
DT = 0.05


def drive(network: RoadNetwork, kind: Any, steps: int, rate: float | None = RATE, **start: Any) -> dict[str, Array]:
    """One car on a road; what it does at each step. It changes to lane 1 after one second, where there is one."""
    road = Road(network, np_random=np.random.RandomState(0))
    car = kind.make_on_lane(road, ("a", "b", 0), 0, speed=start["speed"])
    car.target_speed = start["speed"]
    road.vehicles.append(car)
    if rate is not None:
        steered(rate)(car, 0)
    found: dict[str, list[float]] = {"steering": [], "course": [], "offset": [], "speed": []}
    for step in range(steps):
        if step == round(1 / DT) and len(network.graph["a"]["b"]) > 1:
            car.target_lane_index = ("a", "b", 1)
        road.act()
        heading, speed, offset = car.heading, car.speed, car.road.network.get_lane(car.target_lane_index)
        found["offset"].append(offset.local_coordinates(car.position)[1])
        road.step(DT)
        steering = car.action["steering"]
        found["steering"].append(steering)
        found["course"].append(heading + math.atan(0.5 * math.tan(steering)))
        found["speed"].append(speed)
    return {name: np.array(values) for name, values in found.items()}


def straight() -> RoadNetwork:
    return RoadNetwork.straight_road_network(lanes=2, nodes_str=("a", "b"))


def acceleration(drive: dict[str, Array]) -> Array:
    velocity = drive["speed"] * np.exp(1j * drive["course"])
    return np.abs(np.diff(velocity)) / DT


@pytest.mark.parametrize("rate", [RATE / 2, RATE, 2 * RATE])
def test_the_wheels_never_turn_faster_than_they_can(rate: float) -> None:
    found = drive(straight(), ControlledVehicle, 200, rate, speed=20.0)
    turned = np.abs(np.diff(found["steering"], prepend=0.0)) / DT
    assert turned.max() <= rate * (1 + 1e-9)
    assert turned.max() > 0.5 * rate


def test_a_lane_change_ends_in_the_lane_without_a_velocity_jump() -> None:
    instant = drive(straight(), ControlledVehicle, 200, None, speed=25.0)
    found = drive(straight(), ControlledVehicle, 200, speed=25.0)
    # The course jumps by a quarter of the lateral speed that the controller asks for at once.
    assert acceleration(instant).max() > 50
    assert acceleration(found).max() < 9.81
    assert np.abs(found["offset"][20]) == pytest.approx(4.0, abs=0.01)
    settled = np.abs(found["offset"][20 + round(6 / DT) :])
    assert settled.max() < 0.1
    # No further than the other side of a car's mirror beyond the lane's centre.
    assert found["offset"].max() < 0.2


@pytest.mark.parametrize("speed", [5.0, 10.0])
def test_a_circle_is_driven_on_its_centre_line(speed: float) -> None:
    network = RoadNetwork()
    network.add_lane("a", "b", CircularLane(np.zeros(2), 25.0, 0, 2 * np.pi, clockwise=True))
    found = drive(network, ControlledVehicle, 200, speed=speed)
    settled = slice(round(5 / DT), None)
    assert np.abs(found["offset"][settled]).max() < 0.15
    turning = np.diff(np.unwrap(found["course"]))[settled] / DT
    assert turning == pytest.approx(speed / 25.0, rel=0.02)
    # Of the bicycle, whose slip angle is constant in a circle: sin(slip) = LENGTH / 2 / radius.
    slip = np.arctan(0.5 * np.tan(found["steering"][settled]))
    assert np.sin(slip) == pytest.approx(ControlledVehicle.LENGTH / 2 / 25.0, rel=0.03)


def test_a_kind_of_vehicle_keeps_its_behaviour_and_attributes() -> None:
    road = Road(straight(), np_random=np.random.RandomState(0))
    car = IDMVehicle.make_on_lane(road, ("a", "b", 0), 0, speed=20.0)
    before = dict(vars(car))
    road.vehicles.append(car)
    steered(RATE)(car, 0)
    road.act()
    road.step(DT)
    assert isinstance(car, SteeredVehicle)
    assert isinstance(car, IDMVehicle)
    assert type(car).__mro__[1:3] == (SteeredVehicle, IDMVehicle)
    assert set(vars(car)) == {*before, "steering", "along", "lane", "lane_index"}
    assert not isinstance(IDMVehicle.make_on_lane(road, ("a", "b", 0), 0), SteeredVehicle)


def configured(name: str, **changed: Any) -> HighwayTruth:
    truth = load_scenario(name).config.truth
    assert isinstance(truth, HighwayTruth)
    return HighwayTruth.model_validate({**truth.model_dump(), **changed})


def steering_of(truth: Truth) -> Array:
    """In each step, from its slip angle, which is the course minus the heading: tan(steering) = 2 tan(slip)."""
    course = np.arctan2(np.diff(truth.py, axis=0), np.diff(truth.px, axis=0))
    return np.arctan(2 * np.tan(np.unwrap(course - truth.heading[:-1], axis=0)[..., 0]))


@pytest.mark.parametrize("name", ["highway", "racetrack"])
def test_traffic_steers_at_the_rate_and_has_no_velocity_jump(name: str) -> None:
    few = {"duration_s": 8, "targets": "all"}
    instant = highway.simulate(configured(name, steering_rate_degps=None, **few))
    assert instant.audit["velocity_jumps"]["count"] > 0
    truth = highway.simulate(configured(name, steering_rate_degps=30, **few))
    assert truth.audit["velocity_jumps"]["count"] == 0
    assert truth.audit["velocity_jumps"]["peak_acceleration_mps2"] < 9.81
    there = truth.alive[2:] & truth.alive[:-2]
    turned = np.abs(np.diff(steering_of(truth), axis=0)) * configured(name).rate_hz
    assert turned[there].max() <= RATE * (1 + 1e-6)
    assert truth.source["steering_rate_degps"] == 30


def test_the_rate_is_part_of_the_key() -> None:
    keys = {simulated.cache_file(configured("highway", steering_rate_degps=rate)) for rate in (None, 20, 30)}
    assert len(keys) == 3


def test_without_the_option_the_motion_is_that_of_the_environment() -> None:
    config = HighwayTruth(env="merge-v1", seed=3, duration_s=5, rate_hz=10, ego="idle", observer={"x": 0})
    highway.simulate(config.model_copy(update={"steering_rate_degps": 30}))
    truth = highway.simulate(config)
    env = gymnasium.make("merge-v1", disable_env_checker=True).unwrapped
    env.reset(seed=3, options={"config": {"simulation_frequency": 10}})
    every = 10 // env.config["policy_frequency"]
    for step in range(0, len(truth.time), every):
        bodies = [v.position for v in env.road.vehicles if isinstance(v, ControlledVehicle)]
        np.testing.assert_array_equal(truth.px[step, :, 0], [x for x, _ in bodies])
        np.testing.assert_array_equal(truth.py[step, :, 0], [-y for _, y in bodies])
        env.step(env.action_type.actions_indexes["IDLE"])
    env.close()
