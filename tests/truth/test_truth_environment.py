"""The environment of highway-env: its own settings; the velocity at an instant, where steps have one velocity each; and
vehicles whose front wheels turn at a finite rate, so that velocities do not jump and lanes are followed."""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from highway_env.road.lane import CircularLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.controller import ControlledVehicle

from trackbench.base.types import Array, Observer, Truth
from trackbench.scenario import load_scenario
from trackbench.truth import highway
from trackbench.truth.audit import by_euler
from trackbench.truth.environment import rates_at_instants, steered
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


STEPS, SPEED, RADIUS = 200, 15.0, 20.0
TIME = DT * np.arange(STEPS)


def stepped(course: Array, speed: Array) -> Truth:
    """A body that moves with the given course and speed during each step, and carries the observer too."""
    velocity = speed * np.exp(1j * course)
    position = np.concatenate([[0.0], np.cumsum(velocity[:-1]) * DT])

    def rate(values: Array) -> Array:
        return np.append(np.diff(values), values[-1] - values[-2]) / DT

    column = (slice(None), None, None)
    carrier = Observer(position.real, position.imag, course, velocity.real, velocity.imag, rate(course))
    return Truth(
        time=TIME,
        ids=("car",),
        px=position.real[column],
        py=position.imag[column],
        heading=course[column],
        course=course[column],
        speed=speed[column],
        acceleration=rate(speed)[column],
        yaw_rate=rate(course)[column],
        alive=np.ones((STEPS, 1), dtype=bool),
        length=np.array([5.0]),
        width=np.array([2.0]),
        observer=carrier,
    )


def test_on_a_circle_the_velocity_is_tangential_at_each_instant() -> None:
    truth = stepped(SPEED / RADIUS * TIME, np.full(STEPS, SPEED))
    found = rates_at_instants(truth, by_euler(truth))
    # The positions lie on a circle; its tangent there is the mean of the chords before and after.
    half = 0.5 * SPEED / RADIUS * DT
    np.testing.assert_allclose(found.course[1:, 0, 0], np.angle(np.exp(1j * (SPEED / RADIUS * TIME[1:] - half))))
    np.testing.assert_allclose(found.speed[1:, 0, 0], SPEED * np.cos(half))
    np.testing.assert_allclose(found.yaw_rate, SPEED / RADIUS)
    before = np.hypot(truth.vx - found.vx, truth.vy - found.vy)[1:]
    assert before.max() == pytest.approx(SPEED**2 / RADIUS * DT / 2, rel=1e-3)
    np.testing.assert_allclose(found.observer.vx, found.vx[:, 0, 0])


def test_an_acceleration_is_that_between_the_steps_before_and_after() -> None:
    speed = 10.0 + np.where(TIME < 5.0, 0.0, 2.0 * (TIME - 5.0))
    truth = stepped(np.zeros(STEPS), speed)
    found = rates_at_instants(truth, by_euler(truth))
    np.testing.assert_allclose(found.speed[1:, 0, 0], 0.5 * (speed[1:] + speed[:-1]))
    np.testing.assert_allclose(found.acceleration[1:, 0, 0], np.diff(speed) / DT)
    assert found.acceleration[100, 0, 0] == pytest.approx(0.0, abs=1e-9)
    assert found.acceleration[101, 0, 0] == pytest.approx(2.0)


def test_a_body_at_rest_keeps_its_course_and_others_keep_all() -> None:
    speed = np.where(TIME < 2.0, 5.0, 0.0)
    truth = stepped(np.full(STEPS, 0.7), speed)
    found = rates_at_instants(truth, by_euler(truth))
    np.testing.assert_allclose(found.course, 0.7)
    same = rates_at_instants(truth, np.array([False]))
    for name in ("speed", "course", "acceleration", "yaw_rate"):
        np.testing.assert_array_equal(getattr(same, name), getattr(truth, name))


def test_an_object_has_no_step_before_the_one_in_which_it_appears() -> None:
    truth = stepped(np.zeros(STEPS), 10.0 + TIME)
    truth.alive[:50] = False
    found = rates_at_instants(truth, np.array([True]))
    assert found.speed[50, 0, 0] == truth.speed[50, 0, 0]
    assert found.speed[51, 0, 0] == pytest.approx(truth.speed[51, 0, 0] - 0.5 * DT)
