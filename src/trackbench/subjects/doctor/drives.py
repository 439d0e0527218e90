"""Test drives: scripted scenes with noisy scans, and a tracker's estimates after each scan of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
import yaml
from pydantic import Field

from trackbench.base.config import Config, Name, NonNegative, Positive, Probability
from trackbench.base.types import Array, Mask, Scan, scan_of_member
from trackbench.models.sensors import Dropout, Sensor
from trackbench.sensing.scans import ideal_sensors, sense_known
from trackbench.subjects.doctor.output_checks import OutputChecks
from trackbench.subjects.doctor.probes import Carrier, SensorSite
from trackbench.subjects.doctor.session import StepFailed, TrackerFactory, TrackerSession
from trackbench.trackers.answers import Tracker, shaped_estimate, unpack
from trackbench.truth.config.recording import MovingObserver
from trackbench.truth.config.scripted import ScriptedStart
from trackbench.truth.scripted import script
from trackbench.truth.sources import ScriptedTruth

#: Rate of the truth, Hz: a multiple of all sensors' rates.
TRUTH_RATE = 100


class DriveConfig(Config):
    """True motion and sensing of one test drive, a scripted scene; one entry of drives.yaml."""

    description: str
    truth: ScriptedTruth
    runs: int = Field(4, ge=1)
    rates_hz: list[Positive] | None = None
    """Rate of each sensor in order, repeated from the first if there are more sensors; None for their own rates."""
    detection_probability: Probability = 1
    silent_s: list[NonNegative] | None = None
    """Start and end of an interval without measurements, s; None if measurements never stop."""
    mismatch: float = Field(1.0, ge=1.0)
    """Factor that raises the largest NEES allowed, since sound motion models need not describe the manoeuvre."""

    @property
    def carrier(self) -> Carrier:
        o = self.truth.observer
        assert isinstance(o, MovingObserver)
        return Carrier(o.x, o.y, np.deg2rad(o.yaw_deg), o.vx_mps, o.vy_mps, np.deg2rad(o.turn_rate_degps))


@cache
def drive_configs() -> Mapping[Name, DriveConfig]:
    """Return the settings of all test drives, the entries of drives.yaml, by name."""
    text = files("trackbench.subjects.doctor").joinpath("drives.yaml").read_text(encoding="utf-8")
    scripted = {"source": "scripted", "rate_hz": TRUTH_RATE}
    return {
        name: DriveConfig.model_validate({**entry, "truth": {**scripted, **entry["truth"]}})
        for name, entry in yaml.safe_load(text).items()
    }


class Setting(NamedTuple):
    """Changes that an examination makes to the drives of drives.yaml."""

    site: SensorSite = SensorSite()
    standing: bool = False
    """Whether drives with a moving observer are left out."""
    no_misses: bool = False
    """Whether scans without a detection are left out."""
    own_rates: bool = False
    """Whether the sensors keep their own rates in all drives."""


AS_WRITTEN = Setting()


class TestDrive(NamedTuple):
    """A simulated test drive: the true target, and the scans of all sensors."""

    name: str
    config: DriveConfig
    scans: list[Scan]
    """Scans of all sensors in order of time, with the batch axis ``(runs,)``."""
    time: Array
    """Times of the scans ``(scans,)``, s."""
    target: Array
    """True px, py, vx, vy of the target at each scan ``(4, scans, runs or 1)``."""


def simulate_drives(sensors: Mapping[str, Sensor], seed: int, setting: Setting = AS_WRITTEN) -> list[TestDrive]:
    """Simulate every test drive with the measurements of the sensors.

    Args:
        sensors: sensors by name.
        seed: seed of the noise.
        setting: changes to the drives of drives.yaml.
    """
    return [
        _simulate(name, config, sensors, seed, setting)
        for name, config in drive_configs().items()
        if not (setting.standing and config.carrier.moves)
    ]


def _simulate(name: str, drive: DriveConfig, sensors: Mapping[str, Sensor], seed: int, setting: Setting) -> TestDrive:
    truth = script(_placed(drive, setting.site), seed, name, drive.runs)
    drive_sensors = {}
    for number, (sensor, config) in enumerate(sensors.items()):
        update: dict[str, Any] = {"detection_probability": 1.0 if setting.no_misses else drive.detection_probability}
        if drive.rates_hz is not None and not setting.own_rates:
            update["rate_hz"] = drive.rates_hz[number % len(drive.rates_hz)]
        if drive.silent_s is not None:
            update["dropouts"] = [Dropout(from_s=drive.silent_s[0], to_s=drive.silent_s[1])]
        drive_sensors[sensor] = config.model_copy(update=update)
    scans = sense_known(ideal_sensors(truth, drive_sensors), seed, name, range(drive.runs)).scans
    if setting.no_misses:
        scans = [scan for scan in scans if scan.valid.all()]
    time = np.array([scan.time for scan in scans])
    step = np.searchsorted(truth.time, time - 1e-9)
    target = np.stack([field[step, 0] for field in (truth.px, truth.py, truth.vx, truth.vy)])
    return TestDrive(name, drive, scans, time, target)


def _placed(drive: DriveConfig, site: SensorSite) -> ScriptedTruth:
    """Return the truth with the observer of a site; the target keeps place and velocity relative to the sensor."""
    original, carrier, truth = drive.carrier, site.carrier(drive.carrier), drive.truth
    if carrier == original and not any(site.mount):
        return truth
    (name, body), *_ = truth.objects.items()
    course = np.deg2rad(body.start.course_deg or 0.0)
    speed = body.start.speed_mps or 0.0
    state = np.array([body.start.x, body.start.y, speed * np.cos(course), speed * np.sin(course)])
    x, y, vx, vy = (float(value) for value in site.target(state, original))
    start = ScriptedStart(x=x, y=y, speed_mps=None, course_deg=None, vx_mps=vx, vy_mps=vy)
    observer = MovingObserver(
        x=carrier.x,
        y=carrier.y,
        yaw_deg=float(np.rad2deg(carrier.yaw)),
        vx_mps=carrier.vx,
        vy_mps=carrier.vy,
        turn_rate_degps=float(np.rad2deg(carrier.yaw_rate)),
    )
    objects = {name: body.model_copy(update={"start": start})}
    return truth.model_copy(update={"objects": objects, "observer": observer})


class Rollout(NamedTuple):
    """Estimates of a tracker after each scan of a drive, NaN where there is no estimate."""

    mean: Array
    """Estimated px, py, vx, vy ``(4, scans, runs)``."""
    covariance: Array
    """Covariances of the estimates ``(4, 4, scans, runs)``."""
    has_estimate: Mask
    """Whether the tracker returned an estimate ``(scans, runs)``."""


def rollout(
    make: Callable[[], Tracker], scans: Sequence[Scan], checks: OutputChecks | None = None, drive: str = ""
) -> Rollout:
    """Step a tracker through scans with the batch axis ``(runs,)``, or one tracker per run without batches.

    Raises:
        StepFailed: the tracker raised, or returned no valid estimate.
    """
    batched = bool(getattr(make(), "batched", False))
    estimates = _step_batch(make, scans) if batched else _step_each_run(make, scans)
    if checks is not None:
        k, run = np.nonzero(estimates.has_estimate)

        def scans_from_first_measurement(i: int) -> list[Scan]:
            run_scans = [scan_of_member(scan, int(run[i])) for scan in scans[: k[i] + 1]]
            return run_scans[next(first for first, scan in enumerate(run_scans) if scan.valid) :]

        mean, covariance = estimates.mean[:, k, run], estimates.covariance[:, :, k, run]
        checks.add_batch(mean, covariance, [scans[int(i)] for i in k], drive, scans_from_first_measurement)
    return estimates


def _step_batch(make: Callable[[], Tracker], scans: Sequence[Scan]) -> Rollout:
    tracker, state, estimates = make(), None, _empty_rollout(scans)
    on_step = TrackerFactory.of(make).on_step
    for k, scan in enumerate(scans):
        try:
            state, answer = unpack(tracker.step(state, scan))
            estimate = shaped_estimate(answer, scan)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            # The failure of a single run is raised instead, because it has the scans before it.
            _step_each_run(make, scans[: k + 1])
            raise StepFailed(error, scan_of_member(scan, 0)) from error
        on_step()
        if estimate is not None:
            estimates.mean[:, k], estimates.covariance[:, :, k] = estimate.mean, estimate.covariance
            # A batched tracker returns NaN for a track that has not started.
            estimates.has_estimate[k] = ~np.isnan(estimate.mean).all(axis=0) | (k > 0 and estimates.has_estimate[k - 1])
    return estimates


def _step_each_run(make: Callable[[], Tracker], scans: Sequence[Scan]) -> Rollout:
    estimates = _empty_rollout(scans)
    for run in range(scans[0].valid.size):
        first = next((k for k, scan in enumerate(scans) if scan.valid[run]), len(scans))
        run_scans = [scan_of_member(scan, run) for scan in scans[first:]]
        for k, estimate in enumerate(TrackerSession(make).walk(run_scans) if run_scans else [], start=first):
            if estimate is not None:
                estimates.mean[:, k, run], estimates.covariance[:, :, k, run] = estimate.mean, estimate.covariance
                estimates.has_estimate[k, run] = True
    return estimates


def _empty_rollout(scans: Sequence[Scan]) -> Rollout:
    shape: Any = (len(scans), scans[0].valid.size)
    return Rollout(np.full((4, *shape), np.nan), np.full((4, 4, *shape), np.nan), np.zeros(shape, dtype=bool))
