"""Test drives: scripted scenes with noise, for the tracker under test and for a reference."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
import yaml
from pydantic import Field

from trackbench.base.config import Config, Name, NonNegative, Positive, Probability
from trackbench.base.types import Array, Scan
from trackbench.models.sensors import Dropout, Sensor
from trackbench.sensing.scans import ideal_sensors, sense_known
from trackbench.subjects.doctor.site import Carrier, SensorSite
from trackbench.truth.config import MovingObserver
from trackbench.truth.config.scripted import ScriptedStart
from trackbench.truth.scripted import script
from trackbench.truth.sources import ScriptedTruth

#: Rate of the truth, Hz: a multiple of all sensors' rates.
TRUTH_RATE = 100


class DriveConfig(Config):
    """One entry of drives.yaml."""

    description: str
    truth: ScriptedTruth
    runs: int = Field(4, ge=1)
    rates_hz: list[Positive] | None = None
    """Replace the sensors' own."""
    detection_probability: Probability = 1
    silent_s: list[NonNegative] | None = None
    """Start and end of an interval without measurements."""
    mismatch: float = Field(1.0, ge=1.0)
    """How many times larger the NEES may be than elsewhere, for sound motion models that do not have its manoeuvre."""

    @property
    def carrier(self) -> Carrier:
        """The observer."""
        of = self.truth.observer
        assert isinstance(of, MovingObserver)
        return Carrier(of.x, of.y, np.deg2rad(of.yaw_deg), of.vx_mps, of.vy_mps, np.deg2rad(of.turn_rate_degps))


@cache
def drive_configs() -> Mapping[Name, DriveConfig]:
    """The entries of drives.yaml, by name."""
    text = files("trackbench.subjects.doctor").joinpath("drives.yaml").read_text(encoding="utf-8")
    scripted = {"source": "scripted", "rate_hz": TRUTH_RATE}
    return {
        name: DriveConfig.model_validate({**entry, "truth": {**scripted, **entry["truth"]}})
        for name, entry in yaml.safe_load(text).items()
    }


class Setting(NamedTuple):
    """In what drives differ from drives.yaml."""

    site: SensorSite = SensorSite()
    standing: bool = False
    """Whether no observer moves: drives with a moving one are left out."""
    no_misses: bool = False
    """Whether every scan has a detection: the others are left out."""
    own_rates: bool = False
    """Whether the sensors keep their rates in all drives."""


AS_WRITTEN = Setting()


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


def simulate_drives(sensors: Mapping[str, Sensor], seed: int, setting: Setting = AS_WRITTEN) -> list[TestDrive]:
    """Every drive, measured by the sensors.

    Args:
        sensors: by name.
        seed: of the noise.
        setting: where, and what is assumed.
    """
    return [
        _simulate(name, config, sensors, seed, setting)
        for name, config in drive_configs().items()
        if not (setting.standing and config.carrier.moves)
    ]


def _simulate(name: str, drive: DriveConfig, sensors: Mapping[str, Sensor], seed: int, setting: Setting) -> TestDrive:
    truth = script(_placed(drive, setting.site), seed, name, drive.runs)
    changed = {}
    for number, (sensor, config) in enumerate(sensors.items()):
        update: dict[str, Any] = {"detection_probability": 1.0 if setting.no_misses else drive.detection_probability}
        if drive.rates_hz is not None and not setting.own_rates:
            update["rate_hz"] = drive.rates_hz[number % len(drive.rates_hz)]
        if drive.silent_s is not None:
            update["dropouts"] = [Dropout(from_s=drive.silent_s[0], to_s=drive.silent_s[1])]
        changed[sensor] = config.model_copy(update=update)
    scans = sense_known(ideal_sensors(truth, changed), seed, name, range(drive.runs)).scans
    if setting.no_misses:
        scans = [scan for scan in scans if scan.valid.all()]
    time = np.array([scan.time for scan in scans])
    at = np.searchsorted(truth.time, time - 1e-9)
    target = np.stack([field[at, 0] for field in (truth.px, truth.py, truth.vx, truth.vy)])
    return TestDrive(name, drive, scans, time, target)


def _placed(drive: DriveConfig, site: SensorSite) -> ScriptedTruth:
    """The truth with the observer of a site, and its target at the same place relative to the sensor."""
    own, to, truth = drive.carrier, site.carrier(drive.carrier), drive.truth
    if to == own and not any(site.mount):
        return truth
    (name, body), *_ = truth.objects.items()
    course = np.deg2rad(body.start.course_deg or 0.0)
    speed = body.start.speed_mps or 0.0
    state = np.array([body.start.x, body.start.y, speed * np.cos(course), speed * np.sin(course)])
    x, y, vx, vy = (float(value) for value in site.target(state, own))
    start = ScriptedStart(x=x, y=y, speed_mps=None, course_deg=None, vx_mps=vx, vy_mps=vy)
    observer = MovingObserver(
        x=to.x,
        y=to.y,
        yaw_deg=float(np.rad2deg(to.yaw)),
        vx_mps=to.vx,
        vy_mps=to.vy,
        turn_rate_degps=float(np.rad2deg(to.yaw_rate)),
    )
    objects = {name: body.model_copy(update={"start": start})}
    return truth.model_copy(update={"objects": objects, "observer": observer})
