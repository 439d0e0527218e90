"""Drives with noise, through which a tracker is taken beside a reference."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
import yaml
from pydantic import Field

from trackbench.config import Config, Name, NonNegative, Positive, Probability
from trackbench.models.sensors import Dropout, Sensor
from trackbench.sensing.scans import ideal_sensors, sense
from trackbench.truth.config import ScriptedTruth
from trackbench.truth.scripted import script
from trackbench.types import Array, Scan

#: Of every drive; those of the sensors divide it.
STEPS_PER_SECOND = 100


class Drive(Config):
    """One drive of the battery."""

    purpose: str
    shows: list[str] = Field(default_factory=list)
    """The faults that come out in it."""
    truth: ScriptedTruth
    runs: int = Field(4, ge=1)
    rates_hz: list[Positive] | None = None
    """In place of the sensors' own."""
    detection_probability: Probability = 1
    silent_s: list[NonNegative] | None = None
    """From when to when no sensor reads anything."""


@cache
def battery() -> Mapping[Name, Drive]:
    """Every drive, by name."""
    text = files("trackbench.doctor").joinpath("battery.yaml").read_text(encoding="utf-8")
    return {name: Drive.model_validate(_whole(entry)) for name, entry in yaml.safe_load(text).items()}


def _whole(entry: dict[str, Any]) -> dict[str, Any]:
    return {**entry, "truth": {"source": "scripted", "rate_hz": STEPS_PER_SECOND, **entry["truth"]}}


class Course(NamedTuple):
    """A drive made ready: what is true of it, and what was read."""

    name: str
    drive: Drive
    scans: list[Scan]
    """With the batch axis ``(runs,)``."""
    time: Array
    """``(scans,)`` s."""
    target: Array
    """``(4, scans, runs or 1)`` px, py, vx, vy of the target at each scan."""


def courses(sensors: Mapping[str, Sensor], seed: int) -> list[Course]:
    """Every drive of the battery, seen by some sensors."""
    return [_course(name, drive, sensors, seed) for name, drive in battery().items()]


def _course(name: str, drive: Drive, sensors: Mapping[str, Sensor], seed: int) -> Course:
    truth = script(drive.truth, seed, name, drive.runs)
    changed = {}
    for number, (sensor, config) in enumerate(sensors.items()):
        update: dict[str, Any] = {"detection_probability": drive.detection_probability}
        if drive.rates_hz is not None:
            update["rate_hz"] = drive.rates_hz[number % len(drive.rates_hz)]
        if drive.silent_s is not None:
            update["dropouts"] = [Dropout(from_s=drive.silent_s[0], to_s=drive.silent_s[1])]
        changed[sensor] = config.model_copy(update=update)
    scans = sense(ideal_sensors(truth, changed), seed, name, range(drive.runs)).scans
    time = np.array([scan.time for scan in scans])
    at = np.searchsorted(truth.time, time - 1e-9)
    target = np.stack([field[at, 0] for field in (truth.px, truth.py, truth.vx, truth.vy)])
    return Course(name, drive, scans, time, target)
