"""The audit of a log: every sensor, the clocks, the truth, and what follows for the scenario."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.execution import one_blas_thread
from trackbench.base.types import Progress, no_progress
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.subjects.log_audit.corrections import corrected
from trackbench.subjects.log_audit.direct_checks import Clock, VelocityCheck, clock_of, velocity_check
from trackbench.subjects.log_audit.findings import FAMILY, LogFinding
from trackbench.subjects.log_audit.sensor_audit import SensorAudit, audit_sensor, sensor_findings
from trackbench.subjects.log_audit.sensor_log import SensorLog
from trackbench.subjects.log_audit.simple_findings import clock_findings, hole_findings, truth_findings
from trackbench.truth.recorded import Drive, assemble, read
from trackbench.truth.sources import RecordingTruth


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
    velocities = _velocities(truth, drive)
    of_truth = list(truth_findings(truth, velocities))
    units = [finding for finding in of_truth if finding.changes]
    if units:
        # Range rates are judged by the truth's velocity, so that is put right first.
        fixed = _audited(scenario_of(corrected(loaded, units), loaded.path), progress)
        return replace(fixed, scenario=loaded, velocities=tuple(velocities), findings=(*units, *fixed.findings))
    clipped = drive.clipped()
    looked = assemble.scan_cycles(clipped)
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
    found = [
        *of_truth,
        *hole_findings(drive.motions),
        *clock_findings(clocks, {name: cycles.period for name, cycles in looked.items()}),
        *(finding for item in sensors.values() for finding in sensor_findings(item, level)),
    ]
    duration = max(float(m.time[-1]) for m in drive.motions.values())
    return LogAudit(loaded, sensors, tuple(clocks), tuple(velocities), tuple(found), duration)


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
        assemble.require_measurements(drive, drive.clipped())
    except InputError as error:
        raise loaded.locate(error) from None
    return truth, drive


def _velocities(truth: RecordingTruth, drive: Drive) -> list[VelocityCheck]:
    columns = truth.columns
    key = "vx" if columns is not None and columns.vx is not None else "speed"
    unit = (columns.units.get(key) if columns is not None else None) or truth.units.speed
    bodies = [*drive.motions.items(), *([("observer", drive.observer)] if drive.observer is not None else [])]
    checks = (velocity_check(name, motion, unit) for name, motion in bodies)
    return [check for check in checks if check is not None]


def _with_squares(audit: LogAudit) -> LogAudit:
    """The audit with the mean square of the errors before and after the findings are put in, as far as they can be."""
    findings = audit.findings
    if audit.changes and _refused(audit.scenario, findings):
        findings = tuple(_possible(audit.scenario, finding) for finding in findings)
        audit = replace(audit, findings=findings)
    before = after = _squares(audit.scenario)
    if audit.changes:
        after = _squares(scenario_of(corrected(audit.scenario, findings), audit.scenario.path))
    sensors = {
        name: replace(item, square_before=before.get(name), square_after=after.get(name))
        for name, item in audit.sensors.items()
    }
    return replace(audit, sensors=sensors)


def _possible(loaded: Scenario, finding: LogFinding) -> LogFinding:
    if not finding.changes or not _refused(loaded, (finding,)):
        return finding
    return replace(finding, changes={}, fix="No sensor is so: look for what else is wrong with the log first.")


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
    found = {}
    for name, log in drive.clipped().logs.items():
        config = loaded.config.sensors[name]
        residual = SensorLog(name, config, log, drive, truth, np.ones(len(config.components))).residual({})
        square = (residual / np.array(config.sigmas())[:, None]) ** 2
        square = square[:, np.isfinite(square).all(axis=0)]
        if square.size:
            found[name] = float(square.mean())
    return found
