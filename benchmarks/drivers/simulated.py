"""Congested traffic of highway-env at the speeds of a recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

from trackbench.truth.drivers import Drivers, Traffic
from trackbench.truth.sources import HighwayTruth

from .recorded import DT, SAMPLES, Window

#: Vehicles in a lane, of which the first leads and is not counted.
CARS = 10
#: Driven before it is looked at, s, and windows that are then taken.
SETTLED_S, WINDOWS = 30.0, 3
#: Desired speed of those who follow, m/s: more than congestion allows.
FREE_MPS = 25.0


class Lane:
    """One lane behind a leader who wants ``speed`` m/s; it stands in for an environment."""

    def __init__(self, drivers: Drivers | None, speed: float, seed: int) -> None:
        network = RoadNetwork.straight_road_network(1, length=1e5, nodes_str=("a", "b"))
        self.road, self.steps = Road(network), 0
        config = HighwayTruth(env="highway-v0", seed=seed, duration_s=1, rate_hz=round(1 / DT))
        control = None if drivers is None else Traffic(self, drivers, config)
        gap = 12.0 + 1.8 * speed
        self.cars: list[Any] = []
        for number in range(CARS):
            car = IDMVehicle.make_on_lane(self.road, ("a", "b", 0), gap * (CARS - number), speed=speed)
            car.target_speed = FREE_MPS if number else speed
            self.cars.append(car)
            self.road.vehicles.append(car)
            if control is not None:
                control(car, number)

    def windows(self) -> list[Window]:
        """Of all who follow, one after another."""
        states = []
        for _ in range(round(SETTLED_S / DT) + WINDOWS * SAMPLES):
            self.road.act()
            self.road.step(DT)
            states.append([(car.speed, car.position[1]) for car in self.cars[1:]])
        kept = np.array(states[-WINDOWS * SAMPLES :]).reshape(WINDOWS, SAMPLES, CARS - 1, 2)
        return [Window(*kept[w, :, c].T) for w in range(WINDOWS) for c in range(CARS - 1)]


def congested(drivers: Drivers | None, speeds: Sequence[float], seeds: Iterable[int]) -> list[list[Window]]:
    """The windows of each lane: behind a leader of each of these speeds, by each seed.

    The drivers are steady where ``drivers`` is None.
    """
    return [Lane(drivers, speed, 100 * seed + i).windows() for seed in seeds for i, speed in enumerate(speeds)]
