"""The audit of a log: every sensor, the clocks, the truth, and what follows for the scenario."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from trackbench.base.errors import InputError, counted
from trackbench.base.execution import one_blas_thread
from trackbench.base.files import path_from
from trackbench.base.types import Progress, no_progress
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.scenario.overrides import set_value, with_moved_paths
from trackbench.scenario.source import Origin
from trackbench.scenario.truth import own_source
from trackbench.subjects.log_audit.findings import FAMILY, LogFinding, SensorAudit, quantity_text, sensor_findings
from trackbench.subjects.log_audit.joint_fit import FEWEST_ROWS, joint_fit
from trackbench.subjects.log_audit.noise import detection_shares, residual_noises, unlabelled_detections, with_boxes
from trackbench.subjects.log_audit.sensor_log import (
    CLEARLY,
    Clock,
    SensorLog,
    VelocityCheck,
    clock_of,
    reference_noise,
    velocity_check,
    wrong_units,
)
from trackbench.truth.config.columns import UNITS
from trackbench.truth.recorded import Drive, read_drive
from trackbench.truth.recorded.cycles import Cycles
from trackbench.truth.recorded.drive import Motion, require_measurements, scan_cycles, slope
from trackbench.truth.sources import RecordingTruth


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
        tree["truth"] = with_moved_paths(tree["truth"], lambda path: path_from(path, loaded.folder, folder))
    lines = [f"# {finding.title}." + ("" if finding.changes else " Not put in.") for finding in findings]
    head = [f"# {loaded.path.name} with the findings of `trackbench audit` put in:", *(lines or ["# none."])]
    return "\n".join(head) + "\n" + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, width=100)


def audit_sensor(log: SensorLog, looked: Cycles) -> SensorAudit:
    """Audit one sensor by its measurements within the time of the truth and the times when it looked."""
    if len(log.log.time) < FEWEST_ROWS:
        return SensorAudit(log, (), detection_shares(log, looked, {}))
    units = tuple(wrong_units(log))
    for wrong in units:
        factors = log.factors.copy()
        factors[log.components.index(wrong.component)] *= wrong.factor
        log = replace(log, factors=factors)
    fit = joint_fit(log)
    if fit.inlier.sum() < FEWEST_ROWS:
        return SensorAudit(log, units, detection_shares(log, looked, {}))
    return SensorAudit(log, units, detection_shares(log, looked, fit.errors), fit, residual_noises(log, fit))


#: The truth of a log, and what was read of its files.
Recorded = tuple[RecordingTruth, Drive]
#: Median of the size of a normal error, in standard deviations.
MEDIAN_OF_NORMAL = 0.6745
#: A sensor whose errors are typically more than this many times what the log states has a fault that was not found.
UNEXPLAINED = 10.0


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

    @property
    def unexplained(self) -> list[str]:
        """Why the scenario with the findings put in is of no use yet, a sentence for each sensor; empty if it is."""
        elsewhere = [finding.sensor for finding in self.findings if finding.kind == "elsewhere"]
        reasons = [f"Most detections of {name} are not where the boxes are." for name in elsewhere]
        for name, item in self.sensors.items():
            if item.typical_after is not None and item.typical_after > UNEXPLAINED:
                size = f"{item.typical_after:.3g} times as large as stated"
                reasons.append(f"Even with the findings put in, the errors of {name} are typically {size}.")
        return reasons


#: Rows of one object of the truth that are further apart than this leave a hole, s, and in usual intervals.
HOLE_S, HOLE = 1.0, 5.0
#: More rows than this share without truth are no matter of the first and the last ones.
OUTSIDE = 0.1
#: A yaw rate is that of the yaw, in another unit, if the two are correlated by more than this.
ALIKE = 0.5


def clock_findings(clocks: Iterable[Clock], periods: Mapping[str, float | None]) -> Iterator[LogFinding]:
    """Rows out of order, repetitions, and rows at other times than the truth.

    Args:
        clocks: of the truth and of the sensors.
        periods: of the sensors, s; within half of one, rows of several objects may stand in any order.
    """
    for clock in clocks:
        sensor = None if clock.name == "truth" else clock.name
        order = clock.order
        if clock.outside > OUTSIDE * order.rows:
            yield LogFinding(
                kind="outside",
                sensor=sensor,
                title=f"{clock.name}: many rows are at times without truth",
                evidence=f"{clock.outside} of {counted(order.rows, 'row')} lie outside the time of the truth.",
                fix="Check the units of time of the files, and whether their clocks begin alike.",
            )
        if order.backwards and order.largest_step_back > 0.5 * (periods.get(clock.name) or 0.0):
            back = quantity_text(order.largest_step_back, "s")
            yield LogFinding(
                kind="clock",
                sensor=sensor,
                title=f"{clock.name}: time runs backwards",
                evidence=f"{order.backwards} of {counted(order.rows, 'row')} are earlier than one before them, by up "
                f"to {back}.",
                fix="The rows are read in the order of their times. If the clock was set while it ran, split the log "
                "there: the time offset differs before and after.",
            )
        if order.duplicates:
            yield LogFinding(
                kind="duplicates",
                sensor=sensor,
                title=f"{clock.name}: rows are repeated",
                evidence=f"{order.duplicates} of {counted(order.rows, 'row')} are of an object and a time that came "
                "before.",
                fix="The first of them is read. Remove the others, or give each detection its own time.",
            )


def truth_findings(truth: RecordingTruth, checks: Iterable[VelocityCheck]) -> Iterator[LogFinding]:
    """Velocities that contradict the motion, of all objects of one wrong unit together, and jumps."""
    alike: dict[str | None, list[VelocityCheck]] = {}
    for check in checks:
        if check.contradicts:
            own = check.unit if check.unit is not None and check.name != "observer" else None
            alike.setdefault(own, []).append(check)
        elif check.jumps:
            yield LogFinding(
                kind="truth_jumps",
                sensor=None,
                title=f"truth: {check.name} jumps",
                evidence=f"{counted(check.jumps, 'window')} of half a second with a displacement that its velocity "
                "does not explain.",
                fix="Cut the log there, or repair the positions.",
                component=check.name,
            )
    columns = truth.columns
    for unit, same in alike.items():
        changes = {}
        if unit is not None and columns is not None:
            keys = ["speed"] if columns.speed is not None else ["vx", "vy"]
            changes = {f"truth.columns.units.{key}": unit for key in keys}
        names, worst = ", ".join(check.name for check in same), max(same, key=lambda check: check.difference)
        yield LogFinding(
            kind="truth_velocity",
            sensor=None,
            title=f"truth: the velocity of {names} is " + (f"in {unit}" if unit else "not that of the displacement"),
            evidence=f"They differ by {worst.difference:.2g} m/s (median over windows of half a second or more, "
            f"{worst.name}); the displacement is {worst.scale:.3g} times what the velocity says.",
            fix="; ".join(f"Set {key}: {value}" for key, value in changes.items()) + "."
            if changes
            else "Check unit, frame, sign and time of the velocity; range rates cannot be judged by it.",
            value=worst.difference,
            unit="m/s",
            component=worst.name,
            changes=changes,
        )


def ego_findings(loaded: Scenario, recorded: Recorded) -> Iterator[LogFinding]:
    """Yield the column of the observer's yaw, or else of its yaw rate, that fits in another unit."""
    truth, drive = recorded
    ego, motion = truth.ego, drive.observer
    if ego is None or motion is None or motion.heading is None:
        return
    yaw_unit, rate_unit = (ego.units.get(key) or truth.units.angle for key in ("yaw", "yaw_rate"))
    turned = motion._replace(heading=motion.heading * _other_angle(yaw_unit)[1])
    ratio = _error_ratio(loaded, recorded, (truth, replace(drive, observer=turned)))
    if ratio > CLEARLY:
        yield _ego_finding(
            "yaw", yaw_unit, f"The errors of the sensors are {ratio:.2g} times as large as read (median)."
        )
    elif motion.yaw_rate is not None:
        slope_of_yaw, rate = slope(np.unwrap(motion.heading), motion.time), motion.yaw_rate
        product, square = float(slope_of_yaw @ rate), float(rate @ rate)
        correlation = product / max(np.sqrt(square * float(slope_of_yaw @ slope_of_yaw)), 1e-300)
        scale = product / max(square, 1e-300)
        if correlation > ALIKE and abs(np.log(scale / _other_angle(rate_unit)[1])) < np.log(CLEARLY):
            yield _ego_finding("yaw_rate", rate_unit, f"The yaw changes {scale:.3g} times as fast as it says.")


def _other_angle(unit: str) -> tuple[str, float]:
    """Return the other unit of an angle, and what a value that was read in the first is to be multiplied by."""
    other = "deg" if unit == "rad" else "rad"
    return other, UNITS["angle"][other] / UNITS["angle"][unit]


def _error_ratio(loaded: Scenario, recorded: Recorded, other: Recorded) -> float:
    """Return the errors of a log over those of another reading of it: medians, geometric mean over all components."""
    logarithms: list[float] = []
    for sensor, again in zip(*(_sensor_logs(loaded, each).values() for each in (recorded, other)), strict=True):
        sizes = np.abs([sensor.residual({}), again.residual({})])
        known = np.isfinite(sizes).all(axis=(0, 1))
        if known.any():
            medians = np.maximum(np.median(sizes[:, :, known], axis=2), 1e-12)
            logarithms += np.log(medians[0] / medians[1]).tolist()
    return float(np.exp(np.mean(logarithms))) if logarithms else 1.0


def _ego_finding(key: str, unit: str, evidence: str) -> LogFinding:
    change = {f"truth.ego.units.{key}": _other_angle(unit)[0]}
    title = f"observer: {key.replace('_', ' ')} is in {_other_angle(unit)[0]}, not {unit}"
    (setting,) = change.items()
    return LogFinding("unit", None, title, evidence, f"Set {setting[0]}: {setting[1]}.", component=key, changes=change)


def hole_findings(motions: Mapping[str, Motion]) -> Iterator[LogFinding]:
    """Objects whose truth has holes, through which it is drawn as a straight line."""
    for name, motion in motions.items():
        intervals = np.diff(motion.time)
        if not len(intervals):
            continue
        holes = intervals > max(HOLE_S, HOLE * float(np.median(intervals)))
        if holes.any():
            longest = int(np.argmax(intervals))
            yield LogFinding(
                kind="truth_holes",
                sensor=None,
                title=f"truth: {name} has {counted(int(holes.sum()), 'hole')}",
                evidence=f"The longest, {intervals[longest]:.3g} s, begins at {motion.time[longest]:.2f} s; the truth "
                "is a straight line through it.",
                fix="Give the object another name after a hole.",
                component=name,
            )


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
        recorded = _read(loaded)
        return _with_squares(_audited(loaded, recorded, progress), recorded)


def _audited(loaded: Scenario, recorded: Recorded, progress: Progress) -> LogAudit:
    truth, drive = recorded
    columns = truth.columns
    key = "vx" if columns is not None and columns.vx is not None else "speed"
    unit = (columns.units.get(key) if columns is not None else None) or truth.units.speed
    bodies = [*drive.motions.items(), *([("observer", drive.observer)] if drive.observer is not None else [])]
    checks = (velocity_check(name, motion, unit) for name, motion in bodies)
    velocities = [check for check in checks if check is not None]
    of_truth = [*truth_findings(truth, velocities), *ego_findings(loaded, recorded)]
    units = [finding for finding in of_truth if finding.changes]
    if units:
        # Sensors are judged by the truth's velocity and the observer's heading, so those are put right first.
        fixed = _with_findings(loaded, units)
        audit = _audited(fixed, _read(fixed), progress)
        return replace(audit, scenario=loaded, velocities=tuple(velocities), findings=(*units, *audit.findings))
    looked = scan_cycles(drive.clipped())
    clocks = [clock_of("truth", np.concatenate([m.time for m in drive.motions.values()]), drive.order)]
    sensors: dict[str, SensorAudit] = {}
    for name, sensor in _sensor_logs(loaded, recorded).items():
        progress(len(sensors), len(drive.logs))
        log = drive.logs[name]
        clocks.append(clock_of(name, log.scans, log.order, len(log.time) - len(sensor.log.time)))
        sensors[name] = audit_sensor(sensor, looked[name])
        if name in drive.detections:
            sensors[name] = replace(sensors[name], unlabelled=unlabelled_detections(sensor))
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


def _sensor_logs(loaded: Scenario, recorded: Recorded) -> dict[str, SensorLog]:
    truth, drive = recorded
    reference, sensors = reference_noise(drive), loaded.config.sensors
    return {
        name: SensorLog(name, sensors[name], log, drive, truth, reference, np.ones(len(sensors[name].components)))
        for name, log in drive.clipped().logs.items()
    }


def _read(loaded: Scenario) -> Recorded:
    truth = own_source(loaded)
    if not isinstance(truth, RecordingTruth):
        message = "an audit holds recorded measurements against a recorded truth: truth: {source: recording, ...}"
        if loaded.config.truth.source == "recorded-traffic":
            message += "; `trackbench check` says what recorded traffic implies"
        raise loaded.locate(InputError(message, key="truth.source"))
    kinds = {name: sensor.type for name, sensor in loaded.config.sensors.items()}
    try:
        if truth.without_truth:
            raise InputError("missing: an audit holds the measurements against a truth", key="truth.path")
        if truth.number_of_logs > 1:
            message = f"an audit looks at one log, and these are {truth.number_of_logs}; name one file"
            raise InputError(message, key="truth.path")
        truth = truth.scenes()[0]
        drive = read_drive(truth, kinds, loaded.folder)
        found = {name: with_boxes(name, loaded.config.sensors[name], drive, truth) for name in drive.detections}
        drive = replace(drive, logs={**drive.logs, **found})
        if not drive.logs:
            message = "no sensor's measurements are recorded, so there is nothing to audit"
            raise InputError(message, key="truth.readings")
        require_measurements(drive, drive.clipped())
    except InputError as error:
        raise loaded.locate(error) from None
    return truth, drive


def _with_squares(audit: LogAudit, recorded: Recorded) -> LogAudit:
    """Add the errors of the measurements before and after the findings are put in, as far as a sensor can be so."""
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
    before = after = _squares(audit.scenario, recorded, audit.scenario)
    if audit.changes:
        fixed = _with_findings(audit.scenario, findings)
        after = _squares(fixed, _read(fixed), audit.scenario)
    sensors = {
        name: replace(
            item,
            square_before=before[name].mean if name in before else None,
            square_after=after[name].mean if name in after else None,
            typical_after=after[name].typical if name in after else None,
        )
        for name, item in audit.sensors.items()
    }
    return replace(audit, sensors=sensors)


def _with_findings(loaded: Scenario, findings: Iterable[LogFinding]) -> Scenario:
    return scenario_of(corrected(loaded, findings), loaded.path)


def _refused(loaded: Scenario, findings: tuple[LogFinding, ...]) -> bool:
    """Return whether the scenario with findings put in is not valid."""
    try:
        _with_findings(loaded, findings)
    except InputError:
        return True
    return False


class Squares(NamedTuple):
    """Squares of measurement minus truth over standard deviations."""

    mean: float
    """With the sigmas of the scenario that is read; 1 is right."""
    typical: float
    """Root of the median of the worst component, with the sigmas as logged, over what it is of normal errors."""


def _squares(loaded: Scenario, recorded: Recorded, logged: Scenario) -> dict[str, Squares]:
    """Return the squared errors of each sensor whose measurements are labelled.

    Of unlabelled detections some that are near a box are false alarms.
    """
    squares = {}
    for name, sensor in _sensor_logs(loaded, recorded).items():
        error, reference = sensor.residual({}) ** 2, sensor.reference_variance({})
        new, stated = (
            error / (np.array(each.config.sensors[name].sigmas())[:, None] ** 2 + reference)
            for each in (loaded, logged)
        )
        known = np.isfinite(new).all(axis=0)
        if known.any() and name not in recorded[1].detections:
            typical = np.sqrt(np.median(stated[:, known], axis=1).max()) / MEDIAN_OF_NORMAL
            squares[name] = Squares(float(new[:, known].mean()), float(typical))
    return squares
