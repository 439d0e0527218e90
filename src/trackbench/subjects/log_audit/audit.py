"""The audit of a log: its sensors, clocks and truth, and the corrected scenario."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from trackbench.base.errors import InputError
from trackbench.base.execution import one_blas_thread
from trackbench.base.types import Progress, no_progress
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.scenario.overrides import set_value, with_moved_paths
from trackbench.scenario.truth import own_source
from trackbench.subjects.log_audit.findings import (
    FAMILY,
    LogFinding,
    SensorAudit,
    remaining_errors,
    sensor_findings,
)
from trackbench.subjects.log_audit.joint_fit import FEWEST_ROWS, joint_fit
from trackbench.subjects.log_audit.noise import detection_shares, residual_noises, unlabelled_detections, with_boxes
from trackbench.subjects.log_audit.sensor_log import (
    Clock,
    SensorLog,
    VelocityCheck,
    clock_of,
    velocity_check,
    wrong_units,
)
from trackbench.subjects.log_audit.table_findings import (
    Recorded,
    clock_findings,
    ego_findings,
    hole_findings,
    sensor_logs,
    truth_findings,
)
from trackbench.truth.recorded import read_drive
from trackbench.truth.recorded.cycles import Cycles
from trackbench.truth.recorded.drive import require_measurements, scan_cycles
from trackbench.truth.sources import RecordingTruth


def corrected(loaded: Scenario, findings: Iterable[LogFinding], folder: Path | None = None) -> str:
    """Return the text of the scenario with the corrections of the findings.

    Args:
        loaded: scenario that was audited.
        findings: findings of the audit.
        folder: folder of the new file, to which relative paths are adapted; None for the scenario's own folder.
    """
    tree = copy.deepcopy(loaded.document.value)
    for finding in findings:
        for key, value in finding.changes.items():
            set_value(tree, key, value)
    if folder is not None:
        tree["truth"] = with_moved_paths(tree["truth"], loaded.folder, folder)
    lines = [f"# {finding.title}." + ("" if finding.changes else " Not put in.") for finding in findings]
    head = [f"# {loaded.path.name} with the findings of `trackbench audit` put in:", *(lines or ["# none."])]
    return "\n".join(head) + "\n" + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, width=100)


def yaml_to_paste(loaded: Scenario, findings: Iterable[LogFinding]) -> str:
    """Return the changed keys as YAML to paste into the scenario, changed sensors whole; empty without changes."""
    tree, block = copy.deepcopy(loaded.document.value), dict[str, Any]()
    for key, value in [item for finding in findings for item in finding.changes.items()]:
        set_value(tree, key, value)
        parts = key.split(".")
        if parts[0] == "sensors":
            set_value(block, ".".join(parts[:2]), tree["sensors"][parts[1]])
        else:
            set_value(block, key, value)
    return yaml.safe_dump(block, sort_keys=False, allow_unicode=True, width=78) if block else ""


def audit_sensor(log: SensorLog, cycles: Cycles) -> SensorAudit:
    """Return a sensor's errors, noise and detections, from measurements within the truth's time and scan cycles."""
    if len(log.log.time) < FEWEST_ROWS:
        return SensorAudit(log, (), detection_shares(log, cycles, {}))
    units = tuple(wrong_units(log))
    for wrong in units:
        factors = log.factors.copy()
        factors[log.components.index(wrong.component)] *= wrong.factor
        log = replace(log, factors=factors)
    fit = joint_fit(log)
    if fit.inlier.sum() < FEWEST_ROWS:
        return SensorAudit(log, units, detection_shares(log, cycles, {}))
    return SensorAudit(log, units, detection_shares(log, cycles, fit.errors), fit, residual_noises(log, fit))


#: Median of the absolute value of a normal error, in standard deviations.
MEDIAN_OF_NORMAL = 0.6745
#: Ratio of a sensor's typical error to the stated one above which it must have a fault that was not found.
UNEXPLAINED = 10.0


@dataclass(frozen=True)
class LogAudit:
    """Findings on a recorded log, with the measured properties of its sensors, clocks and velocities."""

    scenario: Scenario
    sensors: dict[str, SensorAudit]
    clocks: tuple[Clock, ...]
    velocities: tuple[VelocityCheck, ...]
    findings: tuple[LogFinding, ...]
    duration_s: float

    @property
    def name(self) -> str:
        return self.scenario.config.name

    @property
    def changes(self) -> dict[str, Any]:
        """Keys of the scenario that the findings change, with their new values."""
        return {key: value for finding in self.findings for key, value in finding.changes.items()}

    @property
    def unexplained(self) -> list[str]:
        """Reasons why the corrected scenario is of no use, one sentence for each sensor; empty where it is of use."""
        elsewhere = [finding.sensor for finding in self.findings if finding.kind == "elsewhere"]
        reasons = [f"Most detections of {name} are not where the boxes are." for name in elsewhere]
        for name, item in self.sensors.items():
            if item.typical_after is not None and item.typical_after > UNEXPLAINED:
                size = f"{item.typical_after:.3g} times as large as stated"
                reasons.append(f"Even with the findings put in, the errors of {name} are typically {size}.")
        return reasons


@one_blas_thread()
def audit_log(loaded: Scenario, progress: Progress = no_progress) -> LogAudit:
    """Audit the recorded sensors of a scenario.

    Args:
        loaded: a scenario whose truth is recorded, with measurements of at least one sensor.
        progress: called with the number of finished sensors and of all sensors.

    Raises:
        InputError: the truth or every sensor is not recorded, or a file is damaged.
    """
    # A value that is too large or too small to compute becomes NaN, which the report shows.
    with np.errstate(all="ignore"):
        recorded = _read_recording(loaded)
        return _with_squares(_audit_recording(loaded, recorded, progress), recorded)


def _audit_recording(loaded: Scenario, recorded: Recorded, progress: Progress) -> LogAudit:
    truth, drive = recorded
    columns = {} if truth.columns is None else truth.columns.stated
    unit = next((columns[key].unit for key in ("vx", "speed") if key in columns), "mps")
    bodies = [*drive.motions.items(), *([("observer", drive.observer)] if drive.observer is not None else [])]
    checks = (velocity_check(name, motion, unit) for name, motion in bodies)
    velocities = [check for check in checks if check is not None]
    logs = sensor_logs(loaded, recorded)
    truth_faults = [*truth_findings(truth, velocities), *ego_findings(loaded, recorded, logs)]
    units = [finding for finding in truth_faults if finding.changes]
    if units:
        # Sensors are compared with the truth's velocity and the observer's heading, which are corrected first.
        fixed = _corrected_scenario(loaded, units)
        audit = _audit_recording(fixed, _read_recording(fixed), progress)
        return replace(audit, scenario=loaded, velocities=tuple(velocities), findings=(*units, *audit.findings))
    cycles = scan_cycles(drive.clipped())
    clocks = [clock_of("truth", np.concatenate([m.time for m in drive.motions.values()]), drive.order)]
    sensors: dict[str, SensorAudit] = {}
    for name, sensor in logs.items():
        progress(len(sensors), len(drive.logs))
        log = drive.logs[name]
        clocks.append(clock_of(name, log.scans, log.order, len(log.time) - len(sensor.log.time)))
        sensors[name] = audit_sensor(sensor, cycles[name])
        if name in drive.detections:
            sensors[name] = replace(sensors[name], unlabelled=unlabelled_detections(sensor))
    progress(len(sensors), len(sensors))
    level = 1 - (1 - FAMILY) / max(1, sum(item.tests for item in sensors.values()))
    findings = [
        *truth_faults,
        *hole_findings(drive.motions),
        *clock_findings(clocks, {name: item.period for name, item in cycles.items()}),
        *(finding for item in sensors.values() for finding in sensor_findings(item, level)),
    ]
    duration = max(float(m.time[-1]) for m in drive.motions.values())
    return LogAudit(loaded, sensors, tuple(clocks), tuple(velocities), tuple(findings), duration)


def _read_recording(loaded: Scenario) -> Recorded:
    truth = own_source(loaded)
    if not isinstance(truth, RecordingTruth):
        message = "an audit compares recorded measurements with a recorded truth: write truth: {source: recording, ...}"
        if loaded.config.truth.source == "recorded-traffic":
            message += "; `trackbench check` says what recorded traffic implies"
        raise loaded.locate(InputError(message, key="truth.source"))
    kinds = {name: sensor.type for name, sensor in loaded.config.sensors.items()}
    try:
        if truth.without_truth:
            raise InputError("missing: an audit compares the measurements with a truth", key="truth.path")
        if truth.number_of_logs > 1:
            message = f"an audit looks at one log, and these are {truth.number_of_logs}; name one file"
            raise InputError(message, key="truth.path")
        truth = truth.scenes()[0]
        drive = read_drive(truth, kinds, loaded.folder)
        assigned = {name: with_boxes(name, loaded.config.sensors[name], drive, truth) for name in drive.detections}
        drive = replace(drive, logs={**drive.logs, **assigned})
        if not drive.logs:
            message = "no sensor's measurements are recorded, so there is nothing to audit"
            raise InputError(message, key="truth.readings")
        require_measurements(drive, drive.clipped())
    except InputError as error:
        raise loaded.locate(error) from None
    return truth, drive


def _with_squares(audit: LogAudit, recorded: Recorded) -> LogAudit:
    """Add each sensor's mean square error before and after the corrections; drop corrections that are invalid."""
    findings = audit.findings
    if audit.changes and _is_refused(audit.scenario, findings):
        no_fix = "No real sensor has such errors: look for another fault of the log first."
        findings = tuple(
            replace(finding, changes={}, fix=no_fix)
            if finding.changes and _is_refused(audit.scenario, (finding,))
            else finding
            for finding in findings
        )
        audit = replace(audit, findings=findings)
    before = after = _squares(audit.scenario, recorded, audit.scenario)
    if audit.changes:
        fixed = _corrected_scenario(audit.scenario, findings)
        after = _squares(fixed, _read_recording(fixed), audit.scenario)
    sensors = {
        name: replace(
            item,
            square_before=before[name].mean if name in before else None,
            square_after=after[name].mean if name in after else None,
            typical_after=after[name].typical if name in after else None,
        )
        for name, item in audit.sensors.items()
    }
    # A fault that has no key stays in the log, and its errors with it.
    uncorrected = {finding.sensor for finding in findings if not finding.changes}
    judged = [item for name, item in sensors.items() if name not in uncorrected]
    remaining = tuple(finding for item in judged if (finding := remaining_errors(item)) is not None)
    return replace(audit, sensors=sensors, findings=(*audit.findings, *remaining))


def _corrected_scenario(loaded: Scenario, findings: Iterable[LogFinding]) -> Scenario:
    return scenario_of(corrected(loaded, findings), loaded.path)


def _is_refused(loaded: Scenario, findings: tuple[LogFinding, ...]) -> bool:
    try:
        _corrected_scenario(loaded, findings)
    except InputError:
        return True
    return False


class Squares(NamedTuple):
    """Sizes of a sensor's errors (measurement minus truth), divided by standard deviations."""

    mean: float
    """Mean of the squared errors, each divided by the variance that the corrected scenario states; 1 is right."""
    typical: float
    """Root median square of the worst component's errors divided by the logged sigma; 1 if normal with this sigma."""


def _squares(loaded: Scenario, recorded: Recorded, logged: Scenario) -> dict[str, Squares]:
    """Return the error sizes of each sensor with labelled measurements; unlabelled measurements can be false alarms."""
    squares = {}
    for name, sensor in sensor_logs(loaded, recorded).items():
        error, reference = sensor.residual({}) ** 2, sensor.reference_variance({})
        square, logged_square = (
            error / (np.array(scenario.config.sensors[name].sigmas())[:, None] ** 2 + reference)
            for scenario in (loaded, logged)
        )
        known = np.isfinite(square).all(axis=0)
        if known.any() and name not in recorded[1].detections:
            typical = np.sqrt(np.median(logged_square[:, known], axis=1).max()) / MEDIAN_OF_NORMAL
            squares[name] = Squares(float(square[:, known].mean()), float(typical))
    return squares
