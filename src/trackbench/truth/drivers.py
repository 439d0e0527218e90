"""Drivers for highway-env's vehicles, who differ from each other and vary over time."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from highway_env.utils import not_zero
from highway_env.vehicle.behavior import IDMVehicle

from trackbench.base.streams import stream
from trackbench.base.units import wrap_angle
from trackbench.truth.config.highway import HighwayOptions
from trackbench.truth.environment import SteeredVehicle, mixed_with, steered

#: Braking for a bend ahead, m/s^2.
COMFORTABLE_BRAKING_MPS2 = 2.0
#: Distance from the start of its lane to which a driver looks for bends, m: enough to brake from 40 m/s.
SEEN_AHEAD_M = 500.0
#: Acceleration and braking of a calm driver, m/s^2. Source: Kesting, Treiber and Helbing (2010), as ``calm_braking``.
CALM_ACCELERATION_MPS2, CALM_BRAKING_MPS2 = 1.4, 2.0
#: Speed above ``calm_from_mps`` at which a driver is fully calm, m/s.
CALM_OVER_MPS = 3.0
#: Distance between headings for the curvature of a lane, m.
SPACING_M = 2.0
#: Default rate of the front wheels, if ``truth.steering_rate_degps`` is not given, degrees per second.
STEERING_RATE_DEGPS = 30.0


@dataclass(frozen=True)
class Drivers:
    """Parameters of drivers who differ and vary at random; ``drivers: human`` has the defaults.

    Acceleration and wander are fitted to recorded traffic; docs/drivers.md has the sources of the other values.
    """

    acceleration_rms_mps2: float = 0.52
    """RMS of the random acceleration added to the driver model's, a Gauss-Markov process."""
    acceleration_full_mps: float = 10.0
    """Speed from which the added acceleration has its full size; below, its size is proportional to the speed."""
    acceleration_time_s: float = 0.8
    """Time in which the autocorrelation of the added acceleration falls to 1/e."""
    wander_m: float = 0.18
    """RMS lateral distance of the car from the centre line of its lane."""
    wander_time_s: float = 0.4
    """Correlation time of the lateral offset that the driver steers for, a Gauss-Markov process."""
    reaction_s: float = 0.7
    """Delay with which the driver perceives the gap and both speeds when braking for the vehicle ahead."""
    speed_spread: float = 0.08
    """Standard deviation over drivers of the desired speed, relative to its mean."""
    headway_s: tuple[float, float] = (1.0, 2.7)
    """Smallest and largest time gap that a driver keeps; uniform between them."""
    calm_from_mps: float = 14.0
    """Speed above which a driver accelerates and brakes by the enhanced intelligent driver model."""
    cornering_mps2: float = 3.0
    """Largest lateral acceleration that a driver accepts in a bend; the driver brakes in time for it."""
    grip_mps2: float = 7.8
    """Largest acceleration of the tyres, longitudinal and lateral combined."""
    jerk_mps3: float = 15.0
    """Largest rate of change of the driver's acceleration, before random acceleration is added and grip limits it."""


HUMAN = Drivers()


class GaussMarkov:
    """First-order Gauss-Markov process (Ornstein-Uhlenbeck), stationary from the start.

    Its autocorrelation is ``sigma^2 exp(-|t| / time_s)``. Sampled exactly at any step ``dt``:
    ``x <- k x + sigma sqrt(1 - k^2) w`` with ``k = exp(-dt / time_s)`` and ``w ~ N(0, 1)``
    (Maybeck, Stochastic Models, Estimation, and Control, volume 1, section 4.11).
    """

    def __init__(self, sigma: float, time_s: float, dt: float, random: np.random.Generator) -> None:
        self._keep = math.exp(-dt / time_s)
        self._drive = sigma * math.sqrt(1.0 - self._keep**2)
        self._random = random
        self.value = sigma * random.standard_normal()

    def advance(self) -> float:
        """Advance the process by one step and return its new value."""
        self.value = self._keep * self.value + self._drive * self._random.standard_normal()
        return self.value


def lateral_gain(time_s: float) -> float:
    """Return the RMS lateral distance of a car, relative to the RMS of the offset that its driver steers for.

    The offset ``w`` is a Gauss-Markov process, which the car follows by ``y'' + a y' + b y = b w`` with
    ``a = 1 / TAU_HEADING`` and ``b = a / TAU_LATERAL``. The variance of ``y`` is the variance of ``w`` times
    ``b (a + c) / (a (b + a c + c^2))`` with ``c = 1 / time_s``, an integral of its spectrum (Newton, Gould and Kaiser,
    Analytical Design of Linear Feedback Controls, appendix E).
    """
    a, c = 1.0 / SteeredVehicle.TAU_HEADING, 1.0 / time_s
    b = a / SteeredVehicle.TAU_LATERAL
    return math.sqrt(b * (a + c) / (a * (b + a * c + c**2)))


class Driver:
    """Random properties and processes of one driver: speed factor, time gap, noise and perception delay.

    Args:
        options: parameters that all drivers share.
        dt: step of the simulation, s.
        seed: seed of the traffic.
        number: number of the vehicle, in order of appearance.
    """

    def __init__(self, options: Drivers, dt: float, seed: int, number: int) -> None:
        def random_stream(purpose: str) -> np.random.Generator:
            return stream(seed, "drivers", number, purpose)

        self.options = options
        self.acceleration = GaussMarkov(
            options.acceleration_rms_mps2, options.acceleration_time_s, dt, random_stream("acceleration")
        )
        wander_sigma = options.wander_m / lateral_gain(options.wander_time_s)
        self.wander = GaussMarkov(wander_sigma, options.wander_time_s, dt, random_stream("wander"))
        # Within two standard deviations, so that nobody drives at half the speed of the others.
        deviation = float(np.clip(random_stream("speed").standard_normal(), -2.0, 2.0))
        self.speed_factor = 1.0 + options.speed_spread * deviation
        self.headway = random_stream("headway").uniform(*options.headway_s)
        self._seen = deque([0.0] * (round(options.reaction_s / dt) + 1), maxlen=round(options.reaction_s / dt) + 1)

    def reacts_to(self, present: float) -> float:
        """Store the present value of a quantity, and return its value one reaction time ago."""
        self._seen.append(present)
        return self._seen[0]


class HumanVehicle(SteeredVehicle):
    """Vehicle with a driver who varies, and who reacts to the road at once but to the vehicle ahead with a delay."""

    driver: Driver
    #: Largest speed in the bends of each lane with bends, by index, m/s.
    BENDS: dict[Any, float]
    #: Acceleration of the model, without the driver's addition, m/s^2.
    intended = 0.0
    #: Course minus heading, rad.
    slip = 0.0
    #: Target lane for which ``bends_ahead`` was computed.
    bends_from: Any = None

    @property
    def target_speed(self) -> float:
        """Desired speed, m/s: the driver model's, times this driver's own factor."""
        return float(self.__dict__["target_speed"] * self.driver.speed_factor)

    @target_speed.setter
    def target_speed(self, value: float) -> None:
        self.__dict__["target_speed"] = value

    def controls(self, dt: float) -> dict[str, float]:
        """Return the driver's steering angle, rad, and acceleration, m/s^2, for a step of ``dt`` s."""
        driver, options = self.driver, self.driver.options
        self.lane_offset_wanted = driver.wander.advance()
        slip_before = self.slip
        controls = super().controls(dt)
        self.slip = math.atan(0.5 * math.tan(self.steering))

        free = max(-self.ACC_MAX, self.free_road_acceleration())
        # At a desired speed of zero the model would creep.
        free = min(free, self.KP_A * max(0.0, self.target_speed - self.speed))
        braking = min(0.0, self.action["acceleration"] - free)
        if self.speed > options.calm_from_mps:
            calm = min(1.0, (self.speed - options.calm_from_mps) / CALM_OVER_MPS)
            free *= 1.0 - calm * (1.0 - CALM_ACCELERATION_MPS2 / self.COMFORT_ACC_MAX)
            braking += calm * (self.calm_braking(braking) - braking)
        perceived = driver.reacts_to(braking)
        if self.BENDS:
            free = min(free, self.KP_A * (self.speed_for_bends() - self.speed))
        wanted = free + perceived
        largest = options.jerk_mps3 * dt
        wanted = max(self.intended - largest, min(self.intended + largest, wanted))
        self.intended = wanted
        # A standing vehicle stays still.
        wanted += driver.acceleration.advance() * min(1.0, abs(self.speed) / options.acceleration_full_mps)
        turning = (self.slip - slip_before) / dt + self.speed * math.sin(slip_before) / (self.LENGTH / 2)
        lateral = self.speed * turning
        largest = min(self.ACC_MAX, math.sqrt(max(0.0, self.GRIP**2 - lateral**2)))
        wanted = max(-largest, min(largest, wanted))
        if self.speed >= 0.0:
            # Brakes do not push backwards.
            wanted = max(wanted, -self.speed / dt)
        return {**controls, "acceleration": wanted}

    def calm_braking(self, braking: float) -> float:
        """Return the acceleration of a calm driver in place of the model's ``braking``, both at most 0 m/s^2.

        A calm driver brakes as hard as needed to avoid the vehicles ahead, plus at most ``CALM_BRAKING_MPS2``.

        Source: Kesting, Treiber and Helbing (2010), "Enhanced intelligent driver model to access the impact of driving
        strategies on traffic capacity", equations 4 to 6.
        """
        if braking > -0.1:
            return braking
        needed = min(map(self._needed_braking, {self.lane_index, self.target_lane_index}))
        if braking >= needed:
            return braking
        return needed + CALM_BRAKING_MPS2 * math.tanh((braking - needed) / CALM_BRAKING_MPS2)

    def _needed_braking(self, lane: Any) -> float:
        ahead, _ = self.road.neighbour_vehicles(self, lane)
        if ahead is None:
            return 0.0
        speed: float = max(0.0, ahead.speed)
        closing: float = max(0.0, self.speed - ahead.speed)
        gap: float = self.lane_distance_to(ahead) - (self.LENGTH + ahead.LENGTH) / 2
        gap = max(0.1, gap - closing * self.driver.options.reaction_s)
        # Comfortable braking of the vehicle ahead is not expected to continue.
        slowing: float = min(0.0, getattr(ahead, "intended", 0.0))
        if slowing > -CALM_BRAKING_MPS2:
            return -(closing**2) / (2.0 * gap)
        if speed * closing <= -2.0 * gap * slowing:
            return float(self.speed**2 * slowing / (speed**2 - 2.0 * gap * slowing))
        return slowing - closing**2 / (2.0 * gap)

    def free_road_acceleration(self) -> float:
        """Return the acceleration on a free road, m/s^2; IDM's is computed in plain floats, five times faster."""
        if type(self).acceleration is not IDMVehicle.acceleration:
            return float(self.acceleration(self, None))
        wanted, limit = self.target_speed, self.lane.speed_limit
        if limit is not None:
            wanted = min(max(wanted, 0.0), limit)
        ratio = max(self.speed, 0.0) / abs(not_zero(wanted))
        return float(self.COMFORT_ACC_MAX * (1.0 - ratio**self.DELTA))

    def speed_for_bends(self) -> float:
        """Return the largest speed from which the driver can brake comfortably for each bend, m/s."""
        if self.target_lane_index != self.bends_from:
            self.bends_from, self.bends_ahead = self.target_lane_index, self._bends_ahead()
        slowest = math.inf
        for start, speed in self.bends_ahead:
            slowest = min(slowest, speed**2 + 2.0 * COMFORTABLE_BRAKING_MPS2 * max(0.0, start - self.along))
        return math.sqrt(slowest)

    def _bends_ahead(self) -> list[tuple[float, float]]:
        """Return, for each lane ahead with a bend, its start, m from the target lane's, and its bend speed, m/s."""
        start, bends = 0.0, []
        for index, lane in self.lanes_ahead():
            if index in self.BENDS:
                bends.append((start, self.BENDS[index]))
            start += lane.length
            if start > SEEN_AHEAD_M:
                break
        return bends


class Traffic:
    """Function called with each new vehicle, to which it gives a driver.

    Args:
        env: environment after its reset.
        options: parameters of the drivers.
        config: options of the simulation.
    """

    def __init__(self, env: Any, options: Drivers, config: HighwayOptions) -> None:
        self._env, self._options, self._seed, self._dt = env, options, config.seed, 1.0 / config.rate_hz
        bends = bend_speeds(env.road.network, options.cornering_mps2)
        rate = math.radians(config.steering_rate_degps or STEERING_RATE_DEGPS)
        self._human = mixed_with(HumanVehicle, STEERING_RATE=rate, GRIP=options.grip_mps2, BENDS=bends)
        self._steered = steered(rate)

    def __call__(self, vehicle: Any, number: int) -> None:
        if not isinstance(vehicle, IDMVehicle):
            self._steered(vehicle, number)
            return
        vehicle.driver = Driver(self._options, self._dt, self._seed, number)
        vehicle.TIME_WANTED = vehicle.driver.headway
        vehicle.__class__ = self._human(type(vehicle))
        if self._env.steps == 0 and vehicle.BENDS:
            # At the start some vehicles are in a bend, faster than tyres allow.
            vehicle.along = vehicle.road.network.get_lane(vehicle.target_lane_index).local_coordinates(
                vehicle.position
            )[0]
            vehicle.speed = min(vehicle.speed, vehicle.speed_for_bends())


def bend_speeds(network: Any, across_mps2: float) -> dict[Any, float]:
    """Return by lane index the speed, m/s, with a lateral acceleration of ``across_mps2`` in the sharpest bend."""
    speeds = {}
    for start, ends in network.graph.items():
        for end, lanes in ends.items():
            for number, lane in enumerate(lanes):
                along = np.linspace(0.0, lane.length, max(2, math.ceil(lane.length / SPACING_M) + 1))
                heading = np.array([lane.heading_at(at) for at in along])
                curvature = float(np.abs(wrap_angle(np.diff(heading))).max() / (along[1] - along[0]))
                if curvature > 1e-6:
                    speeds[start, end, number] = math.sqrt(across_mps2 / curvature)
    return speeds
