"""Test drives: scripted scenes with noise, for the tracker under test and for a reference."""

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
from trackbench.truth.scripted import script
from trackbench.truth.sources import ScriptedTruth
from trackbench.types import Array, Scan

#: Rate of the truth, Hz: a multiple of all sensors' rates.
TRUTH_RATE = 100


class DriveConfig(Config):
    """One entry of drives.yaml."""

    description: str
    shows: list[str] = Field(default_factory=list)
    """The faults that are visible in it."""
    truth: ScriptedTruth
    runs: int = Field(4, ge=1)
    rates_hz: list[Positive] | None = None
    """Replace the sensors' own."""
    detection_probability: Probability = 1
    silent_s: list[NonNegative] | None = None
    """Start and end of an interval without measurements."""
    mismatch: float = Field(1.0, ge=1.0)
    """How many times larger the NEES may be than elsewhere, for sound motion models that do not have its manoeuvre."""


@cache
def drive_configs() -> Mapping[Name, DriveConfig]:
    """The entries of drives.yaml, by name."""
    text = files("trackbench.doctor").joinpath("drives.yaml").read_text(encoding="utf-8")
    return {name: DriveConfig.model_validate(_with_source(entry)) for name, entry in yaml.safe_load(text).items()}


def _with_source(entry: dict[str, Any]) -> dict[str, Any]:
    return {**entry, "truth": {"source": "scripted", "rate_hz": TRUTH_RATE, **entry["truth"]}}


class TestDrive(NamedTuple):
    """The truth and the scans of a drive."""

    name: str
    config: DriveConfig
    scans: list[Scan]
    """With the batch axis ``(runs,)``."""
    time: Array
    """``(scans,)`` s."""
    target: Array
    """``(4, scans, runs or 1)`` px, py, vx, vy of the target at each scan."""


def simulate_drives(sensors: Mapping[str, Sensor], seed: int) -> list[TestDrive]:
    """Every drive, measured by the sensors."""
    return [_simulate(name, config, sensors, seed) for name, config in drive_configs().items()]


def _simulate(name: str, drive: DriveConfig, sensors: Mapping[str, Sensor], seed: int) -> TestDrive:
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
    return TestDrive(name, drive, scans, time, target)
