"""Worlds: the same sensors and trackers, where drivers are steady or human, and sensors ideal or typical.

A world is a set of changes of a scenario.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Literal, get_args

from trackbench.base.errors import InputError

World = Literal["ideal", "human", "typical", "recorded"]
WORLDS: tuple[World, ...] = get_args(World)
MEANING: dict[World, str] = {
    "ideal": "steady drivers, ideal sensors",
    "human": "human drivers, ideal sensors",
    "typical": "human drivers where they are simulated, typical sensors",
    "recorded": "recorded traffic, typical sensors",
}
#: The environments of highway-env whose road is like that of a recording that comes with the package.
MOTORWAYS = ("highway-v0", "highway-fast-v0", "merge-v0", "merge-generic-v0", "two-way-v0", "exit-v0")
#: Rows of each car of the recording per second: no sensor can be faster there.
RECORDED_HZ = 10
#: NGSIM I-80, smoothed, from ten of its cars: each a scene, and no car in two.
I80: dict[str, Any] = {
    "source": "recorded-traffic",
    "format": "i80",
    "observer": {"vehicle": ["13", "36", "51", "60", "66", "74", "294", "309", "311", "331"]},
    "smoothing": {"window_s": 2.1, "order": 2},
}


class NoSuchWorld(InputError):
    """A scenario cannot be in a world."""


def changes(scenario: Mapping[str, Any], world: World) -> list[str]:
    """What makes a scenario, as it is written, one of a world: ``key.path=value`` each.

    Raises:
        NoSuchWorld: it cannot be in it.
    """
    truth, sensors = (part if isinstance(part := scenario.get(key), dict) else {} for key in ("truth", "sensors"))
    return [*_truth(truth, world), *_sensors(sensors, world)]


def _sensors(sensors: Mapping[str, Any], world: World) -> Iterator[str]:
    effects = "typical" if world in ("typical", "recorded") else "ideal"
    for name, sensor in sensors.items():
        yield f"sensors.{name}.effects={effects}"
        rate = sensor.get("rate_hz") if isinstance(sensor, dict) else None
        if world == "recorded" and not (isinstance(rate, int | float) and rate <= RECORDED_HZ):
            yield f"sensors.{name}.rate_hz={RECORDED_HZ}"


def _truth(truth: Mapping[str, Any], world: World) -> Iterator[str]:
    if truth.get("source") == "recording" and (truth.get("readings") or truth.get("format") == "udacity"):
        raise NoSuchWorld("none, for its measurements are recorded, and no world changes them", key="world")
    simulated = truth.get("source") == "highway-env"
    if world == "recorded":
        if not simulated or truth.get("env") not in MOTORWAYS:
            raise NoSuchWorld("none, for no recording of its kind of road comes with trackbench", key="world")
        targets = truth.get("targets")
        named = isinstance(targets, dict) and "ids" in targets
        yield f"truth={json.dumps(I80 | ({} if targets is None or named else {'targets': targets}))}"
    elif simulated:
        yield f"truth.drivers={'steady' if world == 'ideal' else 'human'}"
    elif world == "human":
        raise NoSuchWorld("none, for its truth has no simulated drivers", key="world")
