"""Traffic that steers at a finite rate"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from highway_env.vehicle.controller import ControlledVehicle

from trackbench.base.errors import InputError
from trackbench.scenario import load_scenario
from trackbench.truth import highway
from trackbench.truth.environment import Control, Recorder
from trackbench.truth.jumps import IMPOSSIBLE_MPS2
from trackbench.truth.sources import HighwayTruth

from .claim import Claim

SCENARIOS = ("highway", "highway_dense", "merge", "two_way", "intersection", "racetrack", "u_turn", "roundabout")
SEEDS = range(100, 105)
RATE_DEGPS = 30


class Driven(NamedTuple):
    """How the traffic of several scenes drove."""

    jumps: int
    peak: float
    """m/s^2."""
    offset: float
    """RMS distance of a car from the middle of its lane, while it does not change lanes, m."""
    lane_changes: int
    """Borders between lanes that were crossed."""
    collided: int
    cars: int


class Observed(Recorder):
    """Notes also where every car is in its lane."""

    offsets: list[float]
    lane_changes: int
    bodies: dict[int, Any]

    def __init__(self, env: Any, control: Control | None = None) -> None:
        super().__init__(env, control)
        self.offsets, self.bodies, self.lane_changes = [], {}, 0
        self._lanes: dict[int, Any] = {}
        made.append(self)

    def __call__(self, dt: float) -> None:
        for car in self._env.road.vehicles:
            if isinstance(car, ControlledVehicle) and not car.crashed:
                self.bodies[id(car)] = car
                lane, before = car.lane_index, self._lanes.get(id(car))
                self.lane_changes += before is not None and before[:2] == lane[:2] and before != lane
                self._lanes[id(car)] = lane
                if lane == car.target_lane_index:
                    self.offsets.append(car.lane.local_coordinates(car.position)[1])
        super().__call__(dt)


made: list[Observed] = []


def claims() -> Iterator[Claim]:
    highway.Recorder = Observed  # type: ignore[misc]
    both: list[tuple[Driven, Driven]] = []
    for name in SCENARIOS:
        instant, finite = driven(name, None), driven(name, RATE_DEGPS)
        scenes = f"{name}, {len(SEEDS)} scenes, {RATE_DEGPS} degrees/s"
        yield Claim(
            f"{scenes}: velocity jumps above {IMPOSSIBLE_MPS2:g} m/s^2",
            f"{finite.jumps}, largest acceleration {finite.peak:.1f} m/s^2 "
            f"(instant steering: {instant.jumps}, {instant.peak:.0f} m/s^2)",
            "none",
            finite.jumps == 0,
        )
        yield Claim(
            f"{scenes}: RMS distance from the middle of the lane",
            f"{finite.offset:.2f} m (instant steering: {instant.offset:.2f} m)",
            "at most 0.5 m more",
            finite.offset < instant.offset + 0.5,
            excess=finite.offset - instant.offset - 0.5,
        )
        both.append((instant, finite))
    before, after = ([run[steering] for run in both] for steering in (0, 1))
    changes = [sum(run.lane_changes for run in side) for side in (before, after)]
    yield Claim(
        "all of them: lane changes",
        f"{changes[1]} (instant steering: {changes[0]})",
        "at most 15 % apart",
        abs(changes[1] - changes[0]) <= 0.15 * changes[0],
    )
    collided = [sum(run.collided for run in side) for side in (before, after)]
    cars = sum(run.cars for run in after)
    yield Claim(
        "all of them: cars that collide",
        f"{collided[1]} of {cars} (instant steering: {collided[0]})",
        "at most 5 %",
        collided[1] <= 0.05 * cars,
    )


def driven(name: str, rate: float | None) -> Driven:
    """What the traffic of a scenario does with one steering, in several scenes."""
    config = load_scenario(name).config.truth
    assert isinstance(config, HighwayTruth)
    made.clear()
    audits = []
    for seed in SEEDS:
        changed = {"seed": seed, "steering_rate_degps": rate, "targets": "all"}
        try:
            audits.append(highway.simulate(config.model_copy(update=changed)).audit["velocity_jumps"])
        except InputError:
            # A collision in the first steps, by the choice of the start.
            continue
    bodies = [car for recorder in made for car in recorder.bodies.values()]
    return Driven(
        jumps=sum(audit["count"] for audit in audits),
        peak=max(audit["peak_acceleration_mps2"] for audit in audits),
        offset=float(np.sqrt(np.mean(np.square(np.concatenate([recorder.offsets for recorder in made]))))),
        lane_changes=sum(recorder.lane_changes for recorder in made),
        collided=sum(car.crashed for car in bodies),
        cars=len(bodies),
    )
