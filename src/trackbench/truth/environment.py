"""Additions to a highway-env environment: limited steering rate, recorded steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from highway_env.utils import not_zero, wrap_to_pi
from highway_env.vehicle.controller import ControlledVehicle

from trackbench.base.types import Array, Mask, Truth
from trackbench.base.units import wrap_angle
from trackbench.truth.frames import Frames


class SteeredVehicle(ControlledVehicle):  # type: ignore[misc]
    """Vehicle that follows its target lane with a limited steering rate.

    The controller of ``ControlledVehicle`` is changed: a lateral offset asks for a heading, and a heading error
    for a turn. Both time constants are longer by one factor: the original ones ask for 3 g in a lane change, and a
    limited steering rate would make the vehicle swing. The controller acts on the course instead of the heading,
    and is solved for the steering angle that turns the course at the wanted rate.
    """

    action: dict[str, float]
    #: Largest rate of the steering angle, rad/s.
    STEERING_RATE = math.inf
    #: Largest lateral acceleration, m/s^2.
    GRIP = math.inf
    TAU_HEADING = 0.5
    TAU_LATERAL = 1.5
    #: Distance from the start of its target lane, m.
    along = 0.0
    #: Wanted lateral offset from the lane's centre, m.
    lane_offset_wanted = 0.0

    def step(self, dt: float) -> None:
        if not self.crashed:
            self.action = {**self.action, **self.controls(dt)}
        super().step(dt)

    def controls(self, dt: float) -> dict[str, float]:
        """Return the steering angle, rad, for a step of ``dt`` s."""
        present = getattr(self, "steering", 0.0)
        largest_change = self.STEERING_RATE * dt
        self.steering = present + float(np.clip(self._wanted(present, dt) - present, -largest_change, largest_change))
        return {"steering": self.steering}

    def steering_control(self, target_lane_index: Any) -> float:
        """Return zero, since ``controls`` replaces the original controller."""
        return 0.0

    def _wanted(self, steering: float, dt: float) -> float:
        """Return the angle, rad, to which the controller would steer from ``steering`` to follow the target lane."""
        lane = self.road.network.get_lane(self.target_lane_index)
        along, offset = lane.local_coordinates(self.position)
        self.along = along
        ahead = self._lane_heading(along + self.speed * self.TAU_HEADING)
        offset -= self.lane_offset_wanted
        back = math.asin(float(np.clip(-offset / self.TAU_LATERAL / not_zero(self.speed), -1.0, 1.0)))
        slip = math.atan(0.5 * math.tan(steering))
        wanted = ahead + float(np.clip(back, -math.pi / 4, math.pi / 4))
        fastest = self.GRIP / abs(not_zero(self.speed))
        course_rate = max(-fastest, min(fastest, wrap_to_pi(wanted - self.heading - slip) / self.TAU_HEADING))
        # The course turns with the heading, which the slip angle turns, and with the slip angle itself.
        slip += dt * (course_rate - self.speed * math.sin(slip) / (self.LENGTH / 2))
        limit = math.atan(0.5 * math.tan(self.MAX_STEERING_ANGLE))
        return math.atan(2.0 * math.tan(float(np.clip(slip, -limit, limit))))

    def lanes_ahead(self) -> Iterator[tuple[Any, Any]]:
        """Yield each lane with its index: the target lane, then the lanes that follow it on the route."""
        network, index = self.road.network, self.target_lane_index
        route = list(self.route or ())
        while True:
            lane = network.get_lane(index)
            yield index, lane
            following = network.next_lane(index, route=route, position=lane.position(lane.length, 0))
            if following == index:
                return
            index = following

    def _lane_heading(self, along: float) -> float:
        """Return the heading of the target lane, or of lanes after it, at a distance from its start, m."""
        lanes = self.lanes_ahead()
        _, lane = next(lanes)
        while along > lane.length:
            _, following = next(lanes, (None, None))
            if following is None:
                break
            along -= lane.length
            lane = following
        return float(lane.heading_at(along))


#: Function called with each new vehicle and its number; the ego has number 0.
Control = Callable[[Any, int], None]


def steered(rate: float) -> Control:
    """Return a function, called with each new vehicle, that limits the steering rate (rad/s) of lane followers."""
    steered_kind = mixed_with(SteeredVehicle, STEERING_RATE=rate)

    def control(vehicle: Any, _: int) -> None:
        if isinstance(vehicle, ControlledVehicle):
            vehicle.__class__ = steered_kind(type(vehicle))

    return control


def mixed_with(first: type[Any], **attributes: Any) -> Callable[[Any], type[Any]]:
    """Return a function that derives a class from ``first`` and a given class of vehicles.

    Args:
        first: first base of the derived classes.
        attributes: class attributes of the derived classes.
    """

    @cache
    def mixed(kind: type[Any]) -> type[Any]:
        return type(f"{first.__name__}{kind.__name__}", (first, kind), attributes)

    return mixed


def rates_at_instants(truth: Truth, stepped: Mask) -> Truth:
    """Return the truth with velocity, acceleration and yaw rate at its instants instead of over the following steps.

    A velocity constant over a step is, on the smooth path through the positions, the velocity at the step's middle. At
    an instant the velocity is the mean of the steps before and after, to second order in the step. Otherwise range rate
    and velocity would be ahead of the position: by 0.3 m/s at 12 m/s^2 and 20 Hz.

    Args:
        truth: truth whose rates at an instant are means over the step that begins there.
        stepped: ``(objects,)`` bodies to change; the observer is always changed.
    """
    is_averaged = np.zeros_like(truth.alive)
    is_averaged[1:] = truth.alive[1:] & truth.alive[:-1]
    is_averaged = (is_averaged & stepped)[..., None]

    def middle(values: Array) -> Array:
        return np.where(is_averaged, 0.5 * (values + _before(values)), values)

    vx, vy = middle(truth.vx), middle(truth.vy)
    is_moving = is_averaged & (np.hypot(vx, vy) > 0.0)
    carrier = truth.observer
    vx_of_carrier, vy_of_carrier, turning = (
        0.5 * (rate + _before(rate)) for rate in (carrier.vx, carrier.vy, carrier.yaw_rate)
    )
    return replace(
        truth,
        speed=np.where(is_averaged, np.hypot(vx, vy), truth.speed),
        course=np.where(is_moving, wrap_angle(np.arctan2(vy, vx)), truth.course),
        # The change from the previous step to the next step holds at the instant.
        acceleration=np.where(is_averaged, _before(truth.acceleration), truth.acceleration),
        yaw_rate=middle(truth.yaw_rate),
        observer=replace(carrier, vx=vx_of_carrier, vy=vy_of_carrier, yaw_rate=turning),
    )


def _before(values: Array) -> Array:
    return np.concatenate([values[:1], values[:-1]])


class Recorder:
    """Recorder that replaces ``road.step`` and stores the state of every vehicle at the start of each step.

    Args:
        env: environment to record.
        control: called with each new vehicle, before its first step.
    """

    def __init__(self, env: Any, control: Control | None = None) -> None:
        self.frames: list[dict[int, tuple[float, ...]]] = []
        self._env = env
        self._control = control
        self._bodies: list[Any] = []
        self._numbers: dict[int, int] = {}
        self._step: Callable[[float], None] = env.road.step
        env.road.step = self
        for vehicle in (env.vehicle, *env.road.vehicles):
            self._number(vehicle)

    def __call__(self, dt: float) -> None:
        vehicles = list(self._env.road.vehicles)
        numbers = [self._number(vehicle) for vehicle in vehicles]
        before = [_state(v) for v in vehicles]
        self._step(dt)
        # The step clips the steering, so it is read afterwards.
        self.frames.append(
            {
                number: (*state, float(v.action["steering"]))
                for number, v, state in zip(numbers, vehicles, before, strict=True)
            }
        )

    def __len__(self) -> int:
        """Return the number of vehicles that have appeared so far."""
        return len(self._bodies)

    def _number(self, vehicle: Any) -> int:
        if id(vehicle) not in self._numbers:
            self._numbers[id(vehicle)] = len(self._bodies)
            self._bodies.append(vehicle)  # keeps it alive, so that no other can take its id
            if self._control is not None:
                self._control(vehicle, self._numbers[id(vehicle)])
        return self._numbers[id(vehicle)]

    def result(self, steps: int, dt: float) -> Frames:
        """Return the motion in the first ``steps`` steps of the vehicles present in them; the ego is body 0."""
        raw = _stacked(self.frames[:steps], len(self._bodies))
        present = np.flatnonzero(np.isfinite(raw[0]).any(axis=0))
        return self._frames(raw[:, :, present], present, dt)

    def until_now(self, dt: float, places: int) -> Frames:
        """Return the motion in all steps so far and at the present instant; the ego is body 0.

        The steering of the step that begins now is not known yet; the previous step's is used.

        Args:
            dt: time between frames, s.
            places: number of bodies in the result; bodies beyond the existing vehicles are absent.
        """
        now = {self._number(v): (*_state(v), float(v.action["steering"])) for v in self._env.road.vehicles}
        raw = _stacked([*self.frames, now], max(places, len(self._bodies)))
        return self._frames(raw, range(raw.shape[2]), dt)

    def _frames(self, raw: Array, numbers: Iterable[int], dt: float) -> Frames:
        px, down, clockwise, speed, crashed, steering = raw
        return Frames(
            dt=dt,
            ids=tuple("ego" if i == 0 else f"v{i}" for i in numbers),
            px=px,
            # The simulator's y points down its screen, to the right of the cars; the fixed frame's points up.
            py=-down,
            heading=-clockwise,
            # The slip angle of the kinematic bicycle (Polack et al. 2017): beta = atan(tan(steering) / 2).
            slip=-np.arctan(0.5 * np.tan(steering)),
            speed=speed,
            collided=crashed == 1.0,
            length=self._sizes("LENGTH", numbers),
            width=self._sizes("WIDTH", numbers),
        )

    def _sizes(self, name: str, numbers: Iterable[int]) -> Array:
        count = len(self._bodies)
        return np.array([float(getattr(self._bodies[i], name)) if i < count else 1.0 for i in numbers])


def _state(vehicle: Any) -> tuple[float, ...]:
    """Return x, y, heading, speed and crashed of a vehicle in highway-env's frame: y to the right, angles clockwise."""
    return (*vehicle.position, vehicle.heading, vehicle.speed, vehicle.crashed)


def _stacked(frames: Sequence[Mapping[int, tuple[float, ...]]], bodies: int) -> Array:
    """Return the six state values of all vehicles, ``(6, frames, bodies)``; NaN for an absent body."""
    raw = np.full((6, len(frames), bodies), np.nan)
    for k, frame in enumerate(frames):
        for body, state in frame.items():
            raw[:, k, body] = state
    return raw
