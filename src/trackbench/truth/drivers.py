"""Drivers of highway-env's vehicles who vary, so that those behind them react."""

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
from trackbench.truth.config import HighwayOptions
from trackbench.truth.environment import SteeredVehicle, mixed_with, steered

#: With which a driver brakes for a bend ahead, m/s^2.
COMFORTABLE_BRAKING_MPS2 = 2.0
#: How far a driver looks for bends from the start of its lane, m: beyond where it would brake at 40 m/s.
SEEN_AHEAD_M = 500.0
#: Acceleration and braking of a calm driver, m/s^2. Source: Kesting, Treiber and Helbing (2010), as ``calm_braking``.
CALM_ACCELERATION_MPS2, CALM_BRAKING_MPS2 = 1.4, 2.0
#: So much above ``calm_from_mps`` a driver is wholly calm, m/s.
CALM_OVER_MPS = 3.0
#: Between the headings of which a lane's curvature is taken, m.
SPACING_M = 2.0
#: Rate of the front wheels where ``truth.steering_rate_degps`` is not given, degrees per second.
STEERING_RATE_DEGPS = 30.0


@dataclass(frozen=True)
class Drivers:
    """How drivers vary, who each have a random stream of their own: ``human`` unless another value is given.

    Acceleration and wander are fitted to recorded traffic; the other values have their sources in docs/drivers.md.
    """

    acceleration_rms_mps2: float = 0.52
    """RMS of the acceleration that a driver adds to that of the model: a Gauss-Markov process."""
    acceleration_full_mps: float = 10.0
    """Speed from which on the acceleration has this size; below, the size is in proportion to the speed."""
    acceleration_time_s: float = 0.8
    """Correlation time of the acceleration, to 1/e."""
    wander_m: float = 0.18
    """RMS distance of the car from where its lane leads it."""
    wander_time_s: float = 0.4
    """Correlation time of the place in the lane that the driver steers for: a Gauss-Markov process."""
    reaction_s: float = 0.7
    """Delay of the braking for the vehicle ahead: its gap and both speeds are seen so late."""
    speed_spread: float = 0.08
    """Standard deviation over drivers of the desired speed, relative to its mean."""
    headway_s: tuple[float, float] = (1.0, 2.7)
    """Least and most time gap that a driver keeps, uniform."""
    calm_from_mps: float = 14.0
    """Speed from which on a driver accelerates and brakes as the enhanced intelligent driver model has it."""
    cornering_mps2: float = 3.0
    """Largest acceleration across at which a driver takes a bend, for which it brakes in time."""
    grip_mps2: float = 7.8
    """Largest acceleration of the tyres, along and across together."""
    jerk_mps3: float = 15.0
    """Largest rate of change of the wanted acceleration, before noise is added and grip limits it."""


HUMAN = Drivers()


class GaussMarkov:
    """A first-order Gauss-Markov process (Ornstein-Uhlenbeck), stationary from the start.

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
        """The value one step later."""
        self.value = self._keep * self.value + self._drive * self._random.standard_normal()
        return self.value


def lateral_gain(time_s: float) -> float:
    """RMS distance of a car from the lane's centre, over that of the Gauss-Markov process that its driver steers for.

    The car follows the process ``w`` by ``y'' + a y' + b y = b w`` with ``a = 1 / TAU_HEADING`` and
    ``b = a / TAU_LATERAL``. The variance of the output is an integral of its spectrum (Newton, Gould and Kaiser,
    Analytical Design of Linear Feedback Controls, appendix E): ``b (a + c) / (a (b + a c + c^2))`` of that of ``w``,
    with ``c = 1 / time_s``.
    """
    a, c = 1.0 / SteeredVehicle.TAU_HEADING, 1.0 / time_s
    b = a / SteeredVehicle.TAU_LATERAL
    return math.sqrt(b * (a + c) / (a * (b + a * c + c**2)))


class Driver:
    """What is one driver's own.

    Args:
        options: of all drivers.
        dt: the step of the simulation, s.
        seed: of the traffic.
        number: of the vehicle, by its appearance.
    """

    def __init__(self, options: Drivers, dt: float, seed: int, number: int) -> None:
        def own(purpose: str) -> np.random.Generator:
            return stream(seed, "drivers", number, purpose)

        self.options = options
        self.acceleration = GaussMarkov(
            options.acceleration_rms_mps2, options.acceleration_time_s, dt, own("acceleration")
        )
        wanted = options.wander_m / lateral_gain(options.wander_time_s)
        self.wander = GaussMarkov(wanted, options.wander_time_s, dt, own("wander"))
        # Within two standard deviations: nobody wants to drive at half the speed of the others.
        deviation = float(np.clip(own("speed").standard_normal(), -2.0, 2.0))
        self.speed_factor = 1.0 + options.speed_spread * deviation
        self.headway = own("headway").uniform(*options.headway_s)
        self._seen = deque([0.0] * (round(options.reaction_s / dt) + 1), maxlen=round(options.reaction_s / dt) + 1)

    def reacts_to(self, seen: float) -> float:
        """What was seen ``reaction_s`` ago, and note what is seen now."""
        self._seen.append(seen)
        return self._seen[0]


class HumanVehicle(SteeredVehicle):
    """A vehicle with a driver who varies. What the road asks of it is felt at once, the vehicle ahead later."""

    driver: Driver
    #: Largest speed in the bends of each lane that has some, by index, m/s.
    BENDS: dict[Any, float]
    #: Acceleration of the model, before what the driver adds, m/s^2.
    intended = 0.0
    #: The course minus the heading, rad.
    slip = 0.0
    #: The target lane that ``bends_ahead`` is of.
    bends_from: Any = None

    @property
    def target_speed(self) -> float:
        """The desired speed: that of the model times the driver's own factor, m/s."""
        return float(self.__dict__["target_speed"] * self.driver.speed_factor)

    @target_speed.setter
    def target_speed(self, value: float) -> None:
        self.__dict__["target_speed"] = value

    def controls(self, dt: float) -> dict[str, float]:
        """Steering angle, rad, and acceleration, m/s^2."""
        driver, options = self.driver, self.driver.options
        self.lane_offset_wanted = driver.wander.advance()
        slip_before = self.slip
        controls = super().controls(dt)
        self.slip = math.atan(0.5 * math.tan(self.steering))

        alone = max(-self.ACC_MAX, self.free_road_acceleration())
        # With a desired speed of zero the model would creep.
        alone = min(alone, self.KP_A * max(0.0, self.target_speed - self.speed))
        braking = min(0.0, self.action["acceleration"] - alone)
        if self.speed > options.calm_from_mps:
            calm = min(1.0, (self.speed - options.calm_from_mps) / CALM_OVER_MPS)
            alone *= 1.0 - calm * (1.0 - CALM_ACCELERATION_MPS2 / self.COMFORT_ACC_MAX)
            braking += calm * (self.calm_braking(braking) - braking)
        seen = driver.reacts_to(braking)
        if self.BENDS:
            alone = min(alone, self.KP_A * (self.speed_for_bends() - self.speed))
        wanted = alone + seen
        most = options.jerk_mps3 * dt
        wanted = max(self.intended - most, min(self.intended + most, wanted))
        self.intended = wanted
        # Who stands still does so.
        wanted += driver.acceleration.advance() * min(1.0, abs(self.speed) / options.acceleration_full_mps)
        turning = (self.slip - slip_before) / dt + self.speed * math.sin(slip_before) / (self.LENGTH / 2)
        across = self.speed * turning
        most = min(self.ACC_MAX, math.sqrt(max(0.0, self.GRIP**2 - across**2)))
        wanted = max(-most, min(most, wanted))
        if self.speed >= 0.0:
            # Brakes do not push backwards.
            wanted = max(wanted, -self.speed / dt)
        return {**controls, "acceleration": wanted}

    def calm_braking(self, braking: float) -> float:
        """Return the part of the model's braking that a calm driver takes, m/s^2, both at most 0.

        It is what is needed not to hit the vehicles ahead, and at most ``CALM_BRAKING_MPS2`` more.

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
        # Braking that is no harder than is comfortable is not taken to go on.
        slowing: float = min(0.0, getattr(ahead, "intended", 0.0))
        if slowing > -CALM_BRAKING_MPS2:
            return -(closing**2) / (2.0 * gap)
        if speed * closing <= -2.0 * gap * slowing:
            return float(self.speed**2 * slowing / (speed**2 - 2.0 * gap * slowing))
        return slowing - closing**2 / (2.0 * gap)

    def free_road_acceleration(self) -> float:
        """``self.acceleration(self, None)``, m/s^2; of IDM in plain floats, which take a fifth of the time."""
        if type(self).acceleration is not IDMVehicle.acceleration:
            return float(self.acceleration(self, None))
        wanted, limit = self.target_speed, self.lane.speed_limit
        if limit is not None:
            wanted = min(max(wanted, 0.0), limit)
        ratio = max(self.speed, 0.0) / abs(not_zero(wanted))
        return float(self.COMFORT_ACC_MAX * (1.0 - ratio**self.DELTA))

    def speed_for_bends(self) -> float:
        """The largest speed from which the driver can brake for each bend in comfort, m/s."""
        if self.target_lane_index != self.bends_from:
            self.bends_from, self.bends_ahead = self.target_lane_index, self._bends_ahead()
        slowest = math.inf
        for start, speed in self.bends_ahead:
            slowest = min(slowest, speed**2 + 2.0 * COMFORTABLE_BRAKING_MPS2 * max(0.0, start - self.along))
        return math.sqrt(slowest)

    def _bends_ahead(self) -> list[tuple[float, float]]:
        """Where each lane that bends starts, from the start of the target lane, m, and its speed, m/s."""
        start, bends = 0.0, []
        for index, lane in self.lanes_ahead():
            if index in self.BENDS:
                bends.append((start, self.BENDS[index]))
            start += lane.length
            if start > SEEN_AHEAD_M:
                break
        return bends


class Traffic:
    """Gives each vehicle that appears its driver.

    Args:
        env: the environment, reset.
        options: of the drivers.
        config: of the simulation.
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
            # Of those that are there at the start some are in a bend, faster than tyres allow.
            vehicle.along = vehicle.road.network.get_lane(vehicle.target_lane_index).local_coordinates(
                vehicle.position
            )[0]
            vehicle.speed = min(vehicle.speed, vehicle.speed_for_bends())


def bend_speeds(network: Any, across_mps2: float) -> dict[Any, float]:
    """By the index of each lane that bends, the speed with which its sharpest bend takes ``across_mps2``, m/s."""
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
