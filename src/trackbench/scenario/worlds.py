"""Worlds: the same sensors and trackers, where drivers are steady or human, and sensors ideal or typical.

A world is a set of changes of a scenario.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Literal, get_args

from trackbench.base.errors import InputError
from trackbench.models.sensors.presets import presets

World = Literal["ideal", "human", "typical", "recorded"]
WORLDS: tuple[World, ...] = get_args(World)
MEANING: dict[World, str] = {
    "ideal": "steady drivers where they are simulated, ideal sensors",
    "human": "human drivers, ideal sensors",
    "typical": "human drivers where they are simulated, typical sensors from which vehicles hide others",
    "recorded": "recorded traffic, typical sensors from which vehicles hide others",
}
#: The environments of highway-env whose road is like that of a recording that comes with the package.
MOTORWAYS = ("highway-v0", "highway-fast-v0", "merge-v0", "merge-generic-v0", "two-way-v0", "exit-v0")
#: Rows of each car of the recording per second: no sensor can be faster there.
RECORDED_HZ = 10
#: Cars of NGSIM I-80 that are far enough apart: each is the observer of a scene, and no car is in two.
I80_CARS = ["13", "36", "51", "60", "66", "74", "294", "309", "311", "331"]
#: The recording, smoothed.
I80: dict[str, Any] = {"source": "recorded-traffic", "format": "i80", "smoothing": {"window_s": 2.1, "order": 2}}


class NoSuchWorld(InputError):
    """A scenario cannot be in a world."""


def changes(scenario: Mapping[str, Any], world: World) -> list[str]:
    """What makes a scenario, as it is written, one of a world: ``key.path=value`` each.

    Raises:
        NoSuchWorld: it cannot be in it.
        InputError: it states itself what the world sets, and otherwise.
    """
    truth, sensors = (part if isinstance(part := scenario.get(key), dict) else {} for key in ("truth", "sensors"))
    return [*_truth(truth, world), *_sensors(sensors, world, truth.get("source") == "recorded-traffic")]


def slowed_sensors(scenario: Mapping[str, Any]) -> dict[str, float]:
    """Return the stated rate, Hz, of each sensor that its world sets to that of recorded traffic, by name.

    Args:
        scenario: as it is written, before the changes of its world.
    """
    truth, sensors = (part if isinstance(part := scenario.get(key), dict) else {} for key in ("truth", "sensors"))
    if scenario.get("world") != "recorded" or truth.get("source") == "recorded-traffic":
        return {}
    rates = {name: _rate(sensor) for name, sensor in sensors.items() if isinstance(sensor, dict)}
    return {name: rate for name, rate in rates.items() if rate is not None and rate > RECORDED_HZ}


def _rate(sensor: Mapping[str, Any]) -> float | None:
    """The rate that a sensor states, or that of its preset, Hz; None where neither is a number."""
    preset = presets().get(str(sensor.get("preset")))
    rate = sensor.get("rate_hz", preset and preset.values.get("rate_hz"))
    return rate if isinstance(rate, int | float) else None


def _sensors(sensors: Mapping[str, Any], world: World, recorded: bool) -> Iterator[str]:
    effects = "typical" if world in ("typical", "recorded") else "ideal"
    for name, sensor in sensors.items():
        stated = sensor if isinstance(sensor, dict) else {}
        _refuse_another(stated.get("effects"), effects, world, f"sensors.{name}.effects")
        yield f"sensors.{name}.effects={effects}"
        if effects == "typical":
            _refuse_another(stated.get("occlusion"), True, world, f"sensors.{name}.occlusion")
            yield f"sensors.{name}.occlusion=true"
        rate = _rate(stated)
        if world == "recorded" and not recorded and (rate is None or rate > RECORDED_HZ):
            yield f"sensors.{name}.rate_hz={RECORDED_HZ}"


def _truth(truth: Mapping[str, Any], world: World) -> Iterator[str]:
    if truth.get("source") == "recording" and (truth.get("readings") or truth.get("format") == "udacity"):
        raise NoSuchWorld("none, for its measurements are recorded, and no world changes them", key="world")
    simulated = truth.get("source") == "highway-env"
    drivers = "steady" if world == "ideal" else "human"
    if world == "recorded" and truth.get("source") == "recorded-traffic":
        return
    if world == "recorded":
        if not simulated or truth.get("env") not in MOTORWAYS:
            raise NoSuchWorld("none, for no recording of its kind of road comes with trackbench", key="world")
        targets = truth.get("targets")
        named = isinstance(targets, dict) and "ids" in targets
        seeds = truth.get("seeds")
        number = len(seeds) if isinstance(seeds, list) else seeds if isinstance(seeds, int) else len(I80_CARS)
        recording = I80 | {"observer": {"vehicle": I80_CARS[: max(number, 1)]}}
        yield f"truth={json.dumps(recording | ({} if targets is None or named else {'targets': targets}))}"
    elif simulated:
        _refuse_another(truth.get("drivers"), drivers, world, "truth.drivers")
        yield f"truth.drivers={drivers}"
    elif world == "human":
        raise NoSuchWorld("none, for its truth has no simulated drivers", key="world")


def _refuse_another(stated: Any, value: str | bool, world: World, key: str) -> None:
    if stated not in (None, value):
        word = "true" if value is True else value
        raise InputError(f"the world {world} sets this to {word}: remove it, or leave the worlds out", key=key)
