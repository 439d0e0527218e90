"""Vehicles whose front wheels turn at a finite rate: highway-env's own turn in no time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from highway_env.utils import not_zero, wrap_to_pi
from highway_env.vehicle.controller import ControlledVehicle


class SteeredVehicle(ControlledVehicle):  # type: ignore[misc]
    """A vehicle that follows its target lane with a steering of finite rate; where it wants to go is left as it is.

    The controller is that of ``ControlledVehicle`` (a lateral offset asks for a heading, a heading error for a turn),
    slower by the same factor in both of its time constants, of the course instead of the heading, and solved for the
    steering angle that turns the course at the wanted rate. With the original's time constants it would ask for 3 g
    in a lane change, and a steering of finite rate would make it swing.
    """

    action: dict[str, float]
    #: rad/s.
    STEERING_RATE = math.inf
    TAU_HEADING = 0.5
    TAU_LATERAL = 1.5

    def step(self, dt: float) -> None:
        if not self.crashed:
            now = getattr(self, "steering", 0.0)
            most = self.STEERING_RATE * dt
            self.steering = now + float(np.clip(self._wanted(now, dt) - now, -most, most))
            self.action = {**self.action, "steering": self.steering}
        super().step(dt)

    def _wanted(self, steering: float, dt: float) -> float:
        """The steering angle with which the course turns as the target lane asks for, rad."""
        lane = self.road.network.get_lane(self.target_lane_index)
        along, offset = lane.local_coordinates(self.position)
        ahead = self._lane_heading(along + self.speed * self.TAU_HEADING)
        back = math.asin(float(np.clip(-offset / self.TAU_LATERAL / not_zero(self.speed), -1.0, 1.0)))
        slip = math.atan(0.5 * math.tan(steering))
        wanted = ahead + float(np.clip(back, -math.pi / 4, math.pi / 4))
        course_rate = wrap_to_pi(wanted - self.heading - slip) / self.TAU_HEADING
        # The course turns with the heading, which the slip angle turns, and with the slip angle itself.
        slip += dt * (course_rate - self.speed * math.sin(slip) / (self.LENGTH / 2))
        limit = math.atan(0.5 * math.tan(self.MAX_STEERING_ANGLE))
        return math.atan(2.0 * math.tan(float(np.clip(slip, -limit, limit))))

    def _lane_heading(self, along: float) -> float:
        """The heading of the target lane, or of those after it, at a distance from its start, m."""
        network, index = self.road.network, self.target_lane_index
        route = list(self.route or ())
        lane = network.get_lane(index)
        while along > lane.length:
            following = network.next_lane(index, route=route, position=lane.position(lane.length, 0))
            if following == index:
                break
            along -= lane.length
            index, lane = following, network.get_lane(following)
        return float(lane.heading_at(along))


def limit_steering(env: Any, rate: float) -> None:
    """From now on let every vehicle that follows lanes steer at ``rate`` (rad/s) at most, those to come included."""
    road_step = env.road.step
    steered: dict[type[Any], type[Any]] = {}

    def step(dt: float) -> None:
        for vehicle in env.road.vehicles:
            kind = type(vehicle)
            if isinstance(vehicle, ControlledVehicle) and not isinstance(vehicle, SteeredVehicle):
                if kind not in steered:
                    steered[kind] = type(f"Steered{kind.__name__}", (SteeredVehicle, kind), {"STEERING_RATE": rate})
                vehicle.__class__ = steered[kind]
        road_step(dt)

    env.road.step = step
