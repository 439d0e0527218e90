"""Ground truth from highway-env. Only this package imports highway-env and gymnasium."""

from __future__ import annotations

import contextlib
import inspect
import io
import logging
import math
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import load_env_creator

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.plugins import one_line
from trackbench.base.types import Progress, Truth, no_progress
from trackbench.results.scenario_summary import EndedEarly
from trackbench.truth.audit import audited_truth, by_euler
from trackbench.truth.config.highway import HighwayOptions
from trackbench.truth.frames import (
    Frames,
    bodies_near,
    fixed_observer,
    lane_edges,
    target_bodies,
    with_sizes,
)
from trackbench.truth.jumps import summarised

with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
    warnings.simplefilter("ignore")
    import highway_env  # noqa: F401  (registers the environments)
    from highway_env.envs.common import action as actions
    from highway_env.envs.common.abstract import AbstractEnv
    from highway_env.envs.lane_keeping_env import LaneKeepingEnv
    from highway_env.envs.parking_env import ParkingEnv
    from highway_env.vehicle.behavior import IDMVehicle
    from highway_env.vehicle.controller import ControlledVehicle

    from trackbench.truth.drivers import HUMAN, Traffic
    from trackbench.truth.environment import Control, Recorder, rates_at_instants, steered

#: Cheapest observation: observing takes half of a step, and nothing here uses observations.
NO_OBSERVATION = {"type": "AttributesObservation", "attributes": []}
#: Attributes of the driver model's classes that intersections overwrite.
TUNED = ("DISTANCE_WANTED", "COMFORT_ACC_MAX", "COMFORT_ACC_MIN")
DriverModel = dict[tuple[type[Any], str], Any]
NOT_FOR_IDM = {ParkingEnv: "has no lanes to follow", LaneKeepingEnv: "needs its own dynamic vehicle"}


def list_envs() -> list[str]:
    """List the registered highway-env ids."""
    return sorted(name for name, spec in gymnasium.registry.items() if str(spec.entry_point).startswith("highway_env"))


def validate(config: HighwayOptions) -> None:
    """Build the environment without a step, to find wrong options.

    Raises:
        InputError: unknown id or key, a value of the wrong type, rates that do not divide.
    """
    with isolated():
        prepare_env(config).close()


def simulate(config: HighwayOptions, progress: Progress = no_progress) -> Truth:
    """Run the environment and record every simulation step of every vehicle.

    Args:
        config: environment and options.
        progress: called with the number of simulated steps and the number of all steps.

    Raises:
        InputError: wrong options or environment, a target that never appears, or motion that the audit refuses.
    """
    steps = step_count(config)
    with isolated():
        env = prepare_env(config)
        recorder = Recorder(env, control_of(env, config))
        action = _neutral_action(env.action_type)
        ended = None
        try:
            while len(recorder.frames) < steps and ended is None:
                _, _, terminated, truncated, _ = env.step(action)
                progress(min(len(recorder.frames), steps), steps)
                if terminated or truncated:
                    ended = _reason(env, bool(truncated))
        except Exception as error:
            message = f"{config.env} fails after {len(recorder.frames) / config.rate_hz:.2f} s: {one_line(error)}"
            raise InputError(message, key="truth") from error
        finally:
            env.close()
    frames = recorder.result(steps, 1.0 / config.rate_hz)
    if config.sizes is not None:
        frames = with_sizes(frames, config.sizes, config.seed)
    ended_early = None
    if len(frames.px) < steps:
        ended_early = EndedEarly(time_s=(len(frames.px) - 1) * frames.dt, reason=ended or "")
    return _truth(config, frames, env.road.network.lanes_list(), ended_early)


def step_count(config: HighwayOptions) -> int:
    """Return the number of instants of the truth, including time 0 and the end."""
    return math.floor(config.duration_s * config.rate_hz + 1e-9) + 1


def _truth(config: HighwayOptions, frames: Frames, lanes: list[Any], ended_early: EndedEarly | None) -> Truth:
    carrier = 0 if config.observer == "ego" else None
    observer = frames.carrier(0) if config.observer == "ego" else fixed_observer(config.observer, len(frames.px))
    bodies = targets = target_bodies(config.targets, frames, observer, carrier)
    if not targets:
        raise InputError(f"there is no vehicle to track in {config.env} with this configuration", key="truth.targets")
    if config.others_within_m is not None:
        named = [] if config.targets == "all" else targets
        bodies = bodies_near(config.others_within_m, frames, observer, named, carrier)
    truth = frames.truth(bodies, observer)
    everywhere = [np.append(a, b) for a, b in ((truth.px, observer.px), (truth.py, observer.py))]
    is_unused = {"sizes": config.sizes is None, "drivers": config.drivers == "steady"}
    truth = replace(
        truth,
        roads=lane_edges(lanes, *everywhere),
        source=config.model_dump(mode="json", exclude={"seeds", *(name for name in is_unused if is_unused[name])}),
        target=np.isin(bodies, targets),
    )
    collided = frames.collided[:, bodies], frames.collided[:, 0] & (config.observer == "ego")
    audited = audited_truth(truth, "repair", collided=collided, ended_early=ended_early)
    result = rates_at_instants(audited, by_euler(audited))
    return replace(result, audit={**result.audit, "velocity_jumps": summarised(result).model_dump(mode="json")})


def control_of(env: AbstractEnv, config: HighwayOptions) -> Control | None:
    """Return the function, called with each new vehicle, that gives it a driver or steering; None for neither."""
    if config.drivers == "human":
        return Traffic(env, HUMAN, config)
    rate = config.steering_rate_degps
    return None if rate is None else steered(math.radians(rate))


def prepare_env(config: HighwayOptions) -> AbstractEnv:
    """Return the environment after its reset, with the class of driver that the scenario gives the ego."""
    ids = list_envs()
    if config.env not in ids:
        raise InputError(f"unknown highway-env id {config.env!r}; {nearest_choices(config.env, ids)}", key="truth.env")
    options: dict[str, Any] = {}
    constructor = load_env_creator(str(gymnasium.spec(config.env).entry_point))
    # Some environments of highway-env take no configuration.
    if "config" in inspect.signature(constructor).parameters:
        options["config"] = {"observation": NO_OBSERVATION}
    env: AbstractEnv = gymnasium.make(config.env, disable_env_checker=True, **options).unwrapped
    settings = _settings(config, {**env.config, "observation": type(env).default_config()["observation"]})
    try:
        env.reset(seed=config.seed, options={"config": settings})
    except Exception as error:
        message = f"{config.env} cannot be set up with this configuration: {one_line(error)}"
        raise InputError(message, key="truth.config") from error
    if config.ego == "idm":
        _let_idm_drive(env, config.env)
    if config.drivers == "human" and not any(isinstance(vehicle, IDMVehicle) for vehicle in env.road.vehicles):
        raise InputError(f"{config.env} has no driver who follows a lane; write steady", key="truth.drivers")
    return env


def _settings(config: HighwayOptions, defaults: dict[str, Any]) -> dict[str, Any]:
    stated = config.config
    for key in (key for key in stated if key not in defaults):
        raise InputError(f"unknown key; {nearest_choices(key, defaults)}", key=f"truth.config.{key}")
    simulation = stated.get("simulation_frequency", config.rate_hz)
    if simulation != config.rate_hz:
        raise InputError(
            f"is set by truth.rate_hz ({config.rate_hz}); leave it out", key="truth.config.simulation_frequency"
        )
    policy = stated.get("policy_frequency", defaults["policy_frequency"])
    divisors = [number for number in range(1, config.rate_hz + 1) if config.rate_hz % number == 0]
    if policy not in divisors:
        message = f"{policy!r} does not divide truth.rate_hz ({config.rate_hz}); write one of "
        raise InputError(message + ", ".join(map(str, divisors)), key="truth.config.policy_frequency")
    if defaults.get("length") is not None and stated.get("length") == 0:
        raise InputError("0 draws a length that the seed does not determine; write it", key="truth.config.length")
    settings = {"observation": NO_OBSERVATION, **stated, "simulation_frequency": config.rate_hz}
    if "duration" in defaults and "duration" not in stated:
        settings["duration"] = max(defaults["duration"], config.duration_s + 2.0 / policy)
    return settings


def _let_idm_drive(env: AbstractEnv, name: str) -> None:
    for kind, reason in NOT_FOR_IDM.items():
        if isinstance(env, kind):
            raise InputError(f"{name} {reason}; write ego: idle", key="truth.ego")
    drivers = []
    for ego in env.controlled_vehicles:
        if isinstance(ego, ControlledVehicle):
            driver = IDMVehicle.create_from(ego)
        else:
            driver = IDMVehicle(env.road, ego.position, ego.heading, ego.speed)
        # Rewards read attributes of the vehicle class that the environment made.
        vars(driver).update({key: value for key, value in vars(ego).items() if key not in vars(driver)})
        env.road.vehicles[env.road.vehicles.index(ego)] = driver
        drivers.append(driver)
    env.controlled_vehicles = drivers
    env.define_spaces()


def _neutral_action(kind: actions.ActionType) -> Any:
    if isinstance(kind, actions.MultiAgentAction):
        return tuple(_neutral_action(agent) for agent in kind.agents_action_types)
    if isinstance(kind, actions.DiscreteMetaAction):
        return kind.actions_indexes["IDLE"]
    if isinstance(kind, actions.DiscreteAction):
        return kind.actions_per_axis**kind.size // 2
    ranges = [kind.acceleration_range] * kind.longitudinal + [kind.steering_range] * kind.lateral
    return np.array([np.clip((low + high) / (low - high), -1.0, 1.0) for low, high in ranges])


def _reason(env: AbstractEnv, truncated: bool) -> str:
    if env.vehicle.crashed:
        return "the ego vehicle collides"
    return "the environment's time limit" if truncated else "the environment's terminal state"


@contextlib.contextmanager
def isolated(driver_model: DriverModel | None = None) -> Iterator[None]:
    """Suppress warnings and messages of highway-env, and undo its changes of the driver model.

    Intersections write to attributes of the driver model's class. Without this context a scenario's truth would depend
    on earlier scenarios.

    Args:
        driver_model: parameters of an environment's driver model, set inside the context, and updated at its end.
    """
    log = logging.getLogger("highway_env")
    level, before = log.level, _driver_model()
    log.setLevel(logging.CRITICAL)
    _set_driver_model(driver_model or {})
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)
        if driver_model is not None:
            driver_model.update(_driver_model())
        _set_driver_model(before)


def _driver_model() -> DriverModel:
    return {(cls, name): getattr(cls, name) for cls in _family(IDMVehicle) for name in TUNED}


def _set_driver_model(model: DriverModel) -> None:
    for (cls, name), value in model.items():
        setattr(cls, name, value)


def _family(cls: type[Any]) -> Iterator[type[Any]]:
    yield cls
    for child in cls.__subclasses__():
        yield from _family(child)
