"""The audit of a log: every sensor, the clocks, the truth, and what follows for the scenario."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from trackbench.base.errors import InputError
from trackbench.base.execution import one_blas_thread
from trackbench.base.types import Array, Progress, no_progress
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.scenario.overrides import set_value
from trackbench.scenario.source import Origin
from trackbench.subjects.log_audit.blocks import BlockInterval
from trackbench.subjects.log_audit.findings import (
    EFFECT,
    FAMILY,
    SHAPE,
    SIGMA_OFF,
    LogFinding,
    clock_findings,
    drift_finding,
    error_finding,
    hole_findings,
    outlier_finding,
    shape_finding,
    sigma_finding,
    silence_finding,
    truth_findings,
    unit_finding,
)
from trackbench.subjects.log_audit.joint_fit import FEWEST_ROWS, JointFit, converged, joint_fit
from trackbench.subjects.log_audit.noise import Detections, ResidualNoise, clock_drift, detections_of, noise_of
from trackbench.subjects.log_audit.sensor_log import (
    Clock,
    SensorLog,
    VelocityCheck,
    WrongUnit,
    clock_of,
    velocity_check,
    wrong_units,
)
from trackbench.truth.config.recording import COMPONENT_QUANTITIES
from trackbench.truth.recorded import Drive, read
from trackbench.truth.recorded.drive import Cycles, require_measurements, scan_cycles
from trackbench.truth.sources import RecordingTruth


def error_changes(log: SensorLog, errors: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """By error, the key that takes it out, with its new value."""
    mount, entry = log.config.mount, log.truth.measurements.get(log.name)
    changes: dict[str, dict[str, Any]] = {}
    for name, value in errors.items():
        if name.startswith("mount_"):
            key = "yaw_deg" if name == "mount_yaw" else f"{name.removeprefix('mount_')}_m"
            change = float(np.rad2deg(value)) if name == "mount_yaw" else value
            changes[name] = {f"sensors.{log.name}.mount.{key}": _rounded(getattr(mount, key) + change, change)}
        elif entry is None:
            changes[name] = {}
        elif name == "time_offset":
            key = f"truth.readings.{log.name}.time_offset_s"
            changes[name] = {key: _rounded(entry.time_offset_s + value, value)}
        else:
            component = name.removeprefix("bias_")
            i = log.components.index(component)
            quantity = COMPONENT_QUANTITIES.get(log.config.units[i])
            factor = log.truth.units.factor(quantity, entry.units.get(component)) * log.factors[i]
            # In the unit of the column, before which one that was found wrong is put right.
            stated = entry.bias.get(component, 0.0)
            changes[name] = {
                f"truth.readings.{log.name}.bias.{component}": _rounded(stated + value / factor, value / factor)
            }
    return changes


def sigma_keys(log: SensorLog) -> dict[str, list[int]]:
    """The keys that state a sensor's noise, with the components that each is for."""
    components: dict[str, list[int]] = {}
    for i, key in enumerate(log.config.sigma_options):
        components.setdefault(key, []).append(i)
    return components


def corrected(loaded: Scenario, findings: Iterable[LogFinding], folder: Path | None = None) -> str:
    """The scenario with the findings put in, as the text of a file in a folder.

    Args:
        loaded: the scenario that was audited.
        findings: of the audit.
        folder: the new file's; that of the scenario unless given. Relative paths lead from it to the same files.
    """
    tree = copy.deepcopy(loaded.document.value)
    for finding in findings:
        for key, value in finding.changes.items():
            set_value(tree, key.split("."), value, Origin("the audit"))
    if folder is not None:
        truth = tree["truth"]
        places = [truth, *(truth.get("readings") or {}).values(), (truth.get("columns") or {}).get("observer")]
        for place in places:
            path = place.get("path") if isinstance(place, dict) else None
            if not isinstance(path, str) or "$" in path or path.startswith("~") or Path(path).is_absolute():
                continue
            file = loaded.path.resolve().parent / path
            if file.is_file():
                place["path"] = os.path.relpath(file, folder.resolve())
    lines = [f"# {finding.title}." + ("" if finding.changes else " Not put in.") for finding in findings]
    head = [f"# {loaded.path.name} with the findings of `trackbench audit` put in:", *(lines or ["# none."])]
    return "\n".join(head) + "\n" + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, width=100)


def _rounded(value: float, change: float) -> float:
    """With four digits of what changed."""
    digits = 3 - int(np.floor(np.log10(abs(change)))) if change else 6
    return round(float(value), max(digits, 0))


#: A clock drifts if its offset changes by more than this during the log, s.
DRIFT_S = 0.005
#: More outliers than this share are no tail of the noise.
OUTLIERS = 0.005


@dataclass(frozen=True)
class SensorAudit:
    """What the log says of one sensor."""

    log: SensorLog
    units: tuple[WrongUnit, ...]
    detections: Detections
    fit: JointFit | None = None
    """None where there are too few measurements."""
    noise: tuple[ResidualNoise, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """``(m, m)`` of a measurement: the suggested R."""
    square_before: float | None = None
    """Mean square of the measurements' errors over the stated sigmas, as logged; 1 is right."""
    square_after: float | None = None
    """With the findings put in."""

    @property
    def tests(self) -> int:
        """How many errors, noises and shapes are judged, and the drift."""
        shapes = sum(noise.exponent is not None for noise in self.noise)
        return 0 if self.fit is None else 1 + len(self.fit.estimates) + len(sigma_keys(self.log)) + shapes


def audit_sensor(log: SensorLog, looked: Cycles) -> SensorAudit:
    """Audit one sensor.

    Args:
        log: its measurements within the time of the truth.
        looked: when it looked.
    """
    if len(log.log.time) < FEWEST_ROWS:
        return SensorAudit(log, (), detections_of(log, looked, {}))
    units = tuple(wrong_units(log))
    for wrong in units:
        factors = log.factors.copy()
        factors[log.components.index(wrong.component)] *= wrong.factor
        log = replace(log, factors=factors)
    fit = joint_fit(log)
    if fit.inlier.sum() < FEWEST_ROWS:
        return SensorAudit(log, units, detections_of(log, looked, {}))
    noise, covariance = noise_of(log, fit)
    return SensorAudit(log, units, detections_of(log, looked, fit.errors), fit, tuple(noise), covariance)


def sensor_findings(item: SensorAudit, level: float) -> Iterator[LogFinding]:
    """What is wrong with a sensor.

    Args:
        item: its audit.
        level: probability with which an interval holds the truth, so that all of the log's do so together.
    """
    for wrong in item.units:
        yield unit_finding(item.log, wrong)
    if item.detections.silent_from_s is not None:
        yield silence_finding(item.log.name, item.detections)
    if item.fit is None:
        return
    outliers = int(item.fit.outlier.sum())
    if outliers > OUTLIERS * len(item.fit.inlier):
        yield outlier_finding(item.log.name, outliers, len(item.fit.inlier))
    drift = clock_drift(item.log, item.fit)
    drifts = drift is not None and drift.excludes(0.0, level) and abs(drift.value) > DRIFT_S
    if drift is not None and drifts:
        yield drift_finding(item.log, drift)
    wrong_errors = [
        name
        for name, estimate in item.fit.estimates.items()
        if estimate.effect >= EFFECT and estimate.interval.excludes(0.0, level)
    ]
    start = {name: item.fit.errors[name] for name in wrong_errors}
    changes = error_changes(item.log, converged(item.log, wrong_errors, start) if wrong_errors else {})
    for name in wrong_errors:
        yield error_finding(item.log.name, item.fit.estimates[name], changes[name])
    if not drifts:
        yield from _noises(item, level)


def _noises(item: SensorAudit, level: float) -> Iterator[LogFinding]:
    for key, components in sigma_keys(item.log).items():
        noises = [item.noise[i] for i in components]
        # Logarithm of the standard deviation found over the stated one, the mean of several components.
        logs = [np.log(max(noise.sigma.value, 1e-300) / noise.stated) for noise in noises]
        relative = [noise.sigma.sigma / max(noise.sigma.value, 1e-300) for noise in noises]
        freedom = min(noise.sigma.freedom for noise in noises)
        ratio = BlockInterval(float(np.mean(logs)), float(np.hypot.reduce(relative)) / len(noises), freedom)
        if ratio.excludes(0.0, level) and abs(ratio.value) > np.log(SIGMA_OFF):
            yield sigma_finding(item.log, key, noises, ratio)
    for noise in item.noise:
        shape = noise.exponent
        if shape is not None and shape.excludes(0.0, level) and noise.spread ** abs(shape.value) > SHAPE:
            yield shape_finding(item.log.name, noise, shape)


@dataclass(frozen=True)
class LogAudit:
    """What was found in a log."""

    scenario: Scenario
    sensors: dict[str, SensorAudit]
    clocks: tuple[Clock, ...]
    velocities: tuple[VelocityCheck, ...]
    findings: tuple[LogFinding, ...]
    duration_s: float

    @property
    def name(self) -> str:
        """Of the scenario."""
        return self.scenario.config.name

    @property
    def changes(self) -> dict[str, Any]:
        """All keys of the scenario that the findings change, with their new values."""
        return {key: value for finding in self.findings for key, value in finding.changes.items()}


@one_blas_thread()
def audit_log(loaded: Scenario, progress: Progress = no_progress) -> LogAudit:
    """Audit the recorded sensors of a scenario.

    Args:
        loaded: a scenario whose truth is recorded, with measurements of at least one sensor.
        progress: called with the number of sensors done and of all.

    Raises:
        InputError: the truth is not recorded, no sensor is, or a file is damaged.
    """
    # What is too large or too small to be computed gives no number, and that is said.
    with np.errstate(all="ignore"):
        return _with_squares(_audited(loaded, progress))


def _audited(loaded: Scenario, progress: Progress) -> LogAudit:
    truth, drive = _read(loaded)
    columns = truth.columns
    key = "vx" if columns is not None and columns.vx is not None else "speed"
    unit = (columns.units.get(key) if columns is not None else None) or truth.units.speed
    bodies = [*drive.motions.items(), *([("observer", drive.observer)] if drive.observer is not None else [])]
    checks = (velocity_check(name, motion, unit) for name, motion in bodies)
    velocities = [check for check in checks if check is not None]
    of_truth = list(truth_findings(truth, velocities))
    units = [finding for finding in of_truth if finding.changes]
    if units:
        # Range rates are judged by the truth's velocity, so that is put right first.
        fixed = _audited(scenario_of(corrected(loaded, units), loaded.path), progress)
        return replace(fixed, scenario=loaded, velocities=tuple(velocities), findings=(*units, *fixed.findings))
    clipped = drive.clipped()
    looked = scan_cycles(clipped)
    clocks = [clock_of("truth", np.concatenate([m.time for m in drive.motions.values()]), drive.order)]
    sensors: dict[str, SensorAudit] = {}
    for number, (name, log) in enumerate(drive.logs.items()):
        progress(number, len(drive.logs))
        inside, config = clipped.logs[name], loaded.config.sensors[name]
        clocks.append(clock_of(name, log.scans, log.order, len(log.time) - len(inside.time)))
        sensor = SensorLog(name, config, inside, drive, truth, np.ones(len(config.components)))
        sensors[name] = audit_sensor(sensor, looked[name])
    progress(len(sensors), len(sensors))
    level = 1 - (1 - FAMILY) / max(1, sum(item.tests for item in sensors.values()))
    findings = [
        *of_truth,
        *hole_findings(drive.motions),
        *clock_findings(clocks, {name: cycles.period for name, cycles in looked.items()}),
        *(finding for item in sensors.values() for finding in sensor_findings(item, level)),
    ]
    duration = max(float(m.time[-1]) for m in drive.motions.values())
    return LogAudit(loaded, sensors, tuple(clocks), tuple(velocities), tuple(findings), duration)


def _read(loaded: Scenario) -> tuple[RecordingTruth, Drive]:
    truth = loaded.config.truth
    if not isinstance(truth, RecordingTruth):
        message = "an audit needs a recording: truth: {source: recording, ...}"
        raise loaded.locate(InputError(message, key="truth.source"))
    kinds = {name: sensor.type for name, sensor in loaded.config.sensors.items()}
    try:
        if truth.without_truth:
            raise InputError("missing: an audit holds the measurements against a truth", key="truth.path")
        drive = read(truth, kinds, loaded.path.resolve().parent)
        if not drive.logs:
            message = "no sensor's measurements are recorded, so there is nothing to audit"
            raise InputError(message, key="truth.readings")
        require_measurements(drive, drive.clipped())
    except InputError as error:
        raise loaded.locate(error) from None
    return truth, drive


def _with_squares(audit: LogAudit) -> LogAudit:
    """The audit with the mean square of the errors before and after the findings are put in, as far as they can be."""
    findings = audit.findings
    if audit.changes and _refused(audit.scenario, findings):
        none = "No sensor is so: look for what else is wrong with the log first."
        findings = tuple(
            replace(finding, changes={}, fix=none)
            if finding.changes and _refused(audit.scenario, (finding,))
            else finding
            for finding in findings
        )
        audit = replace(audit, findings=findings)
    before = after = _squares(audit.scenario)
    if audit.changes:
        after = _squares(scenario_of(corrected(audit.scenario, findings), audit.scenario.path))
    sensors = {
        name: replace(item, square_before=before.get(name), square_after=after.get(name))
        for name, item in audit.sensors.items()
    }
    return replace(audit, sensors=sensors)


def _refused(loaded: Scenario, findings: tuple[LogFinding, ...]) -> bool:
    """Whether the scenario with findings put in is not valid."""
    try:
        scenario_of(corrected(loaded, findings), loaded.path)
    except InputError:
        return True
    return False


def _squares(loaded: Scenario) -> dict[str, float]:
    """By sensor, the mean square of measurement minus truth over the stated sigmas."""
    truth, drive = _read(loaded)
    squares = {}
    for name, log in drive.clipped().logs.items():
        config = loaded.config.sensors[name]
        residual = SensorLog(name, config, log, drive, truth, np.ones(len(config.components))).residual({})
        square = (residual / np.array(config.sigmas())[:, None]) ** 2
        square = square[:, np.isfinite(square).all(axis=0)]
        if square.size:
            squares[name] = float(square.mean())
    return squares
