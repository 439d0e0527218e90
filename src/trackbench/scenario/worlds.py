"""Worlds: variants of a scenario in which drivers are steady, human or recorded, and sensors ideal or typical.

A world is a set of changes of a scenario; trackers and types of sensors stay.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Literal, get_args

from trackbench.base.errors import InputError
from trackbench.models.sensors.presets import presets

World = Literal["ideal", "human", "typical", "recorded"]
WORLDS: tuple[World, ...] = get_args(World)
#: Rate of the recorded traffic, Hz; no sensor can be faster there.
RECORDED_HZ = 10
MEANING: dict[World, str] = {
    "ideal": "steady drivers where they are simulated, ideal sensors",
    "human": "human drivers, ideal sensors",
    "typical": "human drivers where they are simulated, typical sensors from which vehicles hide others",
    "recorded": f"recorded traffic (NGSIM I-80 for simulated, with sensors of at most {RECORDED_HZ} Hz), typical "
    "sensors from which vehicles hide others",
}
#: Environments of highway-env on a motorway, like the recordings that come with the package.
MOTORWAYS = ("highway-v0", "highway-fast-v0", "merge-v0", "merge-generic-v0", "two-way-v0", "exit-v0")
#: Observers of the recorded scenes, cars of NGSIM I-80 that are so far apart that no other car is in two scenes.
I80_CARS = ["13", "36", "51", "60", "66", "74", "294", "309", "311", "331"]
#: Truth of the world ``recorded``: NGSIM I-80, smoothed.
I80: dict[str, Any] = {"source": "recorded-traffic", "format": "i80", "smoothing": {"window_s": 2.1, "order": 2}}


class NoSuchWorldError(InputError):
    """Error: a scenario cannot be changed into a world (a kind of drivers and sensors)."""


def changes(scenario: Mapping[str, Any], world: World) -> list[str]:
    """Return the changes, ``key.path=value`` each, that give a scenario the drivers and sensors of a world.

    Raises:
        NoSuchWorldError: the world does not fit the scenario.
        InputError: the scenario itself sets a key that the world would change.
    """
    truth, sensors = (part if isinstance(part := scenario.get(key), dict) else {} for key in ("truth", "sensors"))
    return [*_truth(truth, world), *_sensors(sensors, world, truth.get("source") == "recorded-traffic")]


def _sensors(sensors: Mapping[str, Any], world: World, recorded: bool) -> Iterator[str]:
    effects = "typical" if world in ("typical", "recorded") else "ideal"
    for name, sensor in sensors.items():
        keys = sensor if isinstance(sensor, dict) else {}
        _refuse_another(keys.get("effects"), effects, world, f"sensors.{name}.effects")
        yield f"sensors.{name}.effects={effects}"
        if effects == "typical":
            _refuse_another(keys.get("occlusion"), True, world, f"sensors.{name}.occlusion")
            yield f"sensors.{name}.occlusion=true"
        preset = presets().get(str(keys.get("preset")))
        rate = keys.get("rate_hz", preset and preset.values.get("rate_hz"))
        if world == "recorded" and not recorded and not (isinstance(rate, int | float) and rate <= RECORDED_HZ):
            yield f"sensors.{name}.rate_hz={RECORDED_HZ}"


def _truth(truth: Mapping[str, Any], world: World) -> Iterator[str]:
    if truth.get("source") == "recording" and (truth.get("readings") or truth.get("format") == "udacity"):
        raise NoSuchWorldError("none, for its measurements are recorded, and no world changes them", key="world")
    simulated = truth.get("source") == "highway-env"
    drivers = "steady" if world == "ideal" else "human"
    if world == "recorded" and truth.get("source") == "recorded-traffic":
        return
    if world == "recorded":
        if not simulated or truth.get("env") not in MOTORWAYS:
            raise NoSuchWorldError("none, for no recording of its kind of road comes with trackbench", key="world")
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
        raise NoSuchWorldError("none, for its truth has no simulated drivers", key="world")


def _refuse_another(stated: Any, value: str | bool, world: World, key: str) -> None:
    if stated not in (None, value):
        word = "true" if value is True else value
        raise InputError(f"the world {world} sets this to {word}: remove it, or leave the worlds out", key=key)
