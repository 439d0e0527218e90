"""The findings of an audit, in words and as changes to the scenario."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.metrics.blocks import BlockInterval
from trackbench.sensing.detections import stated_detection
from trackbench.subjects.log_audit.explanations import explanations
from trackbench.subjects.log_audit.joint_fit import ErrorEstimate, JointFit, solve_errors
from trackbench.subjects.log_audit.noise import Detections, ResidualNoise, Unlabelled, clock_drift
from trackbench.subjects.log_audit.sensor_log import BODY_POINT, SensorLog, WrongUnit
from trackbench.truth.config.columns import Column

#: Smallest factor between estimated and stated standard deviation that makes a finding.
SIGMA_OFF = 1.1
#: Largest change of a time offset during the log that is no drift, s.
DRIFT_S = 0.005
#: Largest share of outliers that may be the tail of the noise.
OUTLIERS = 0.005


#: Most detections are away from their boxes if boxes get fewer than this share of the stated detections, and more than
#: this share of the missing detections are found near no box.
ELSEWHERE = 0.5
#: Mean square of the corrected errors over the stated sigmas from which on something else is wrong.
REMAINING = 1.5
#: Kind of a finding that has several possible causes.
UNDECIDED = "undecided"
#: Probability that a log without errors gives no finding of an error or a noise.
FAMILY = 0.95


@dataclass(frozen=True)
class LogFinding:
    """Fault of a log, with its evidence and its correction."""

    kind: str
    """Kind of fault, such as ``time_offset``, ``mount_yaw``, ``bias_range``, ``sigma``, ``unit`` or ``silence``."""
    sensor: str | None
    """Name of the sensor; None for a fault of the truth."""
    title: str
    evidence: str
    fix: str
    value: float | None = None
    """Estimated size in SI units and radians; None where there is none."""
    ci95: tuple[float, float] | None = None
    unit: str | None = None
    candidates: dict[str, float] = field(default_factory=dict)
    """Errors that explain the log equally well, with their values in SI units and radians; empty for a single error."""
    component: str | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    """Changes of the scenario that correct the fault, by dotted key; empty where the log itself has to be changed."""


@dataclass(frozen=True)
class SensorAudit:
    """Measured properties of one sensor of a log: wrong units, errors, noise and detections."""

    log: SensorLog
    units: tuple[WrongUnit, ...]
    detections: Detections
    fit: JointFit | None = None
    """Joint fit of the sensor's errors; None with too few measurements."""
    noise: tuple[ResidualNoise, ...] = ()
    square_before: float | None = None
    """Mean square of measurement minus truth, each divided by the stated sigma, before corrections; 1 is right."""
    square_after: float | None = None
    """Mean square of measurement minus truth, each divided by the corrected sigma, after corrections; 1 is right."""
    typical_after: float | None = None
    """Ratio of the worst component's typical error to the logged sigma, after corrections but of noise; 1 is right."""
    unlabelled: Unlabelled | None = None
    """Statistics of detections without labels; None for a sensor with labels."""

    @property
    def tests(self) -> int:
        """Number of hypotheses that the audit of the sensor tests: errors, noises and the drift of the clock."""
        errors = 0 if self.fit is None else len(self.fit.estimates) + len(self.log.errors)
        return 0 if self.fit is None else 1 + errors + len(sigma_keys(self.log))


#: Factor and symbol of the units in which angles and times are shown.
_SHOWN_UNITS = {"rad": (180 / np.pi, "°"), "s": (1e3, " ms")}
_STATEMENTS = {
    "time_offset": ("time stamps are {} late", "time stamps are {} early"),
    "mount_yaw": (
        "mount is turned {} to the right of what is stated",
        "mount is turned {} to the left of what is stated",
    ),
    "mount_x": ("mount is {} behind where it is stated", "mount is {} in front of where it is stated"),
    "mount_y": ("mount is {} to the right of where it is stated", "mount is {} to the left of where it is stated"),
    BODY_POINT: (
        "measurements are of a point of the body {} behind that of the truth",
        "measurements are of a point of the body {} in front of that of the truth",
    ),
}
#: Conditions that tell each kind of error from the other kinds.
_WHERE_TO_LOOK = {
    "time_offset": "where objects stand, brake or accelerate, as a clock moves nothing that stands still",
    "mount": "where objects are at other bearings, as an error of the mount stays with the sensor",
    "bias": "where objects are at other bearings and ranges, as a bias is the same for all",
    BODY_POINT: "where objects turn or drive the other way, as a point of the body turns with it",
}


def error_words(name: str) -> str:
    """Return the name of an error in words: "time offset", "bias of range rate"."""
    if name.startswith("bias_"):
        return f"bias of {name.removeprefix('bias_').replace('_', ' ')}"
    return name.replace("_", " ")


def quantity_text(value: float, unit: str, *, signed: bool = False) -> str:
    """Return a value as text with its unit: degrees for angles, ms for times."""
    factor, name = _SHOWN_UNITS.get(unit, (1.0, f" {unit}"))
    return f"{value * factor:{'+' if signed else ''}.3g}{name}"


def bounds_text(bounds: tuple[float, float], unit: str) -> str:
    """Return the bounds of an interval as text: "0.48 to 0.52 m"."""
    factor, name = _SHOWN_UNITS.get(unit, (1.0, f" {unit}"))
    low, high = (bound * factor for bound in bounds)
    width = abs(high - low)
    places = int(np.clip(1 - np.floor(np.log10(width)), 0, 6)) if np.isfinite(width) and width > 0 else 3
    return f"{low:.{places}f} to {high:.{places}f}{name}"


def statement(name: str, value: float, unit: str) -> str:
    """Return an error of a sensor in words: "time stamps are 80 ms late"."""
    size = quantity_text(abs(value), unit)
    if name in _STATEMENTS:
        return _STATEMENTS[name][int(value > 0)].format(size)
    component = name.removeprefix("bias_").replace("_", " ")
    return f"{component} reads {size} too {'much' if value > 0 else 'little'}"


def error_finding(log: SensorLog, item: ErrorEstimate, changes: Mapping[str, Any]) -> LogFinding:
    """Return the finding of an error of time, mount, bias or measured point."""
    value, unit = item.interval.value, item.unit
    evidence = (
        f"{error_words(item.name)} {quantity_text(value, unit, signed=True)} "
        f"(95 %: {bounds_text(item.interval.bounds(), unit)}); "
        f"it moves a measurement by {item.effect:.2g} sigma (RMS)."
    )
    if item.rivals:
        return _undecided_finding(log, item, evidence)
    setting = "; ".join(f"{key}: {new}" for key, new in changes.items())
    fix = f"Set {setting}" if changes else "Correct the log: this format has no key for it"
    if item.name == BODY_POINT:
        fix = "Move the truth's positions there"
    return LogFinding(
        kind=item.name,
        sensor=log.name,
        title=f"{log.name}: its {statement(item.name, value, unit)}",
        evidence=evidence,
        fix=f"{fix}.",
        value=value,
        ci95=item.interval.bounds(),
        unit=unit,
        changes=dict(changes),
    )


def _undecided_finding(log: SensorLog, item: ErrorEstimate, evidence: str) -> LogFinding:
    """Return the finding that one of several errors is present and the log cannot tell which."""
    candidates = {item.name: item.interval.value, **item.rivals}
    statements = [f"its {statement(name, value, log.errors[name])}" for name, value in candidates.items()]
    kinds = dict.fromkeys(name if name in _WHERE_TO_LOOK else name.partition("_")[0] for name in candidates)
    return LogFinding(
        kind=UNDECIDED,
        sensor=log.name,
        title=f"{log.name}: {', or '.join(statements)}",
        evidence=f"Each alone explains this log as well as the others. {evidence}",
        fix=f"Nothing is put in. Look {'; and '.join(_WHERE_TO_LOOK[kind] for kind in kinds)}.",
        candidates=candidates,
    )


def error_changes(log: SensorLog, errors: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Return for each error the scenario's key that corrects it, with its new value; empty where there is no key."""
    mount, entry = log.config.mount, log.truth.measurements.get(log.name)
    changes: dict[str, dict[str, Any]] = {}
    for name, value in errors.items():
        if name.startswith("mount_"):
            key = "yaw_deg" if name == "mount_yaw" else f"{name.removeprefix('mount_')}_m"
            change = float(np.rad2deg(value)) if name == "mount_yaw" else value
            changes[name] = {f"sensors.{log.name}.mount.{key}": _rounded(getattr(mount, key) + change, change)}
        elif entry is None or name == BODY_POINT:
            changes[name] = {}
        elif name == "time_offset":
            key = f"truth.readings.{log.name}.time_offset_s"
            changes[name] = {key: _rounded(entry.time_offset_s + value, value)}
        else:
            component = name.removeprefix("bias_")
            i = log.components.index(component)
            factor = log.columns.get(component, Column(component)).factor * log.factors[i]
            # The bias is in the unit of the column, after a wrong unit is corrected.
            stated = entry.bias.get(component, 0.0)
            changes[name] = {
                f"truth.readings.{log.name}.bias.{component}": _rounded(stated + value / factor, value / factor)
            }
    return changes


def _rounded(value: float, change: float) -> float:
    """Round a value so that the change keeps four digits."""
    digits = 3 - int(np.floor(np.log10(abs(change)))) if change else 6
    return round(float(value), max(digits, 0))


def unit_finding(log: SensorLog, wrong: WrongUnit) -> LogFinding:
    """Return the finding that a component is in another unit or has the other sign."""
    name, component = log.name, wrong.component.replace("_", " ")
    unit = log.config.units[log.components.index(wrong.component)]
    same = wrong.fits == wrong.stated
    title = f"{name}: {component} " + ("counts the other way" if same else f"is in {wrong.fits}, not {wrong.stated}")
    if wrong.turned and not same:
        title += ", and counts the other way"
    evidence = (
        f"The spread of measurement minus truth is {quantity_text(wrong.spread[0], unit)} as read, and "
        f"{quantity_text(wrong.spread[1], unit)} so (median)."
    )
    changes = {}
    if wrong.component in log.columns and not same:
        source = log.columns[wrong.component].name
        changes = {f"truth.readings.{name}.{wrong.component}": f"{source}:{wrong.fits}"}
    steps = [f"Set {key}: {value}" for key, value in changes.items()]
    steps += [f"change the sign of the column of {component}"] if wrong.turned else []
    return LogFinding(
        kind="sign" if same else "unit",
        sensor=name,
        title=title,
        evidence=evidence,
        fix=f"{' and '.join(steps) or 'Correct the log'}.",
        component=wrong.component,
        changes={} if wrong.turned else changes,
    )


def sigma_finding(log: SensorLog, key: str, noises: list[ResidualNoise], ratio: BlockInterval) -> LogFinding:
    """Return the finding that the noise differs from the stated sigma by a factor, whose logarithm is ``ratio``."""
    stated = float(getattr(log.config, key))
    value = stated * float(np.exp(ratio.value))
    low, high = (stated * float(np.exp(bound)) for bound in ratio.bounds())
    unit = noises[0].unit
    names = " and ".join(noise.name.replace("_", " ") for noise in noises)
    factor = noises[0].stated / stated
    digits = 3 - int(np.floor(np.log10(value)))
    new = round(value, max(digits, 0))
    return LogFinding(
        kind="sigma",
        sensor=log.name,
        title=f"{log.name}: the noise of {names} is {np.exp(ratio.value):.2f} times what is stated",
        evidence=f"Standard deviation {quantity_text(value * factor, unit)} (95 %: "
        f"{bounds_text((low * factor, high * factor), unit)}), stated {quantity_text(stated * factor, unit)}.",
        fix=f"Set sensors.{log.name}.{key}: {new}.",
        value=value * factor,
        ci95=(low * factor, high * factor),
        unit=unit,
        component=noises[0].name,
        changes={f"sensors.{log.name}.{key}": new},
    )


def sensor_findings(item: SensorAudit, level: float) -> Iterator[LogFinding]:
    """Yield the findings on a sensor, from intervals at ``level``, which allows for all tests of the log."""
    sensor, detections, fit = item.log.name, item.detections, item.fit
    for wrong in item.units:
        yield unit_finding(item.log, wrong)
    misplaced = _misplaced_boxes(item)
    if misplaced is not None:
        # The few detections that fit by chance say nothing about noise and time.
        yield misplaced
        return
    if detections.silent_from_s is not None:
        yield LogFinding(
            kind="silence",
            sensor=sensor,
            title=f"{sensor}: silent for {detections.silent_for_s:.3g} s",
            evidence=f"From {detections.silent_from_s:.2f} s on nothing was detected, though objects were in its field "
            f"of view; elsewhere it detects {100 * detections.share.value:.0f} %.",
            fix="Rows are missing, or something stood before it, or its clock was set forward there. State dropouts in "
            "the scenario, so that its gap is known.",
        )
    if fit is None:
        return
    outliers, rows = int(fit.outlier.sum()), len(fit.inlier)
    if outliers > OUTLIERS * rows and item.unlabelled is None:
        yield LogFinding(
            kind="outliers",
            sensor=sensor,
            title=f"{sensor}: {100 * outliers / rows:.1f} % of its measurements are outliers",
            evidence=f"{outliers} of {rows} are further than four sigma from the truth, where normal noise leaves less "
            "than one in a thousand.",
            fix="They are clutter, reflections or of another object. They are left out here, but not in a run.",
        )
    drift = clock_drift(item.log, fit)
    drifts = drift is not None and drift.excludes(0.0, level) and abs(drift.value) > DRIFT_S
    if drift is not None and drifts:
        yield LogFinding(
            kind="clock_drift",
            sensor=sensor,
            title=f"{sensor}: its time offset changes by {quantity_text(drift.value, 's', signed=True)} during the log",
            evidence=f"95 %: {bounds_text(drift.bounds(), 's')}, from the first measurement to the last.",
            fix="Its clock drifts or was set while it ran: compare it with that of the truth, or split the log, and "
            "audit again: until then the noise that is found is not the sensor's alone.",
            value=drift.value,
            ci95=drift.bounds(),
            unit="s",
        )
    shown = explanations(item.log, fit, level)
    start = {error.name: error.interval.value for error in shown}
    changes = error_changes(item.log, solve_errors(item.log, [*start], start) if start else {})
    for error in shown:
        yield error_finding(item.log, error, changes[error.name])
    if not drifts:
        yield from _noise_findings(item, level)


def remaining_errors(item: SensorAudit) -> LogFinding | None:
    """Return the finding that errors remain which no correction explains; None where the errors are as stated."""
    if item.square_after is None or item.square_after < REMAINING or item.fit is None:
        return None
    return LogFinding(
        kind="remaining",
        sensor=item.log.name,
        title=f"{item.log.name}: errors remain that nothing above corrects",
        evidence=f"With the findings put in, the mean square of measurement minus truth over the stated sigmas is "
        f"{item.square_after:.3g}, where 1 is right: the noise above is not the sensor's alone.",
        fix="Look at the errors over time in the report's replay. A clock that was set during the log, a mount that "
        "moved, or measurements of another object do this; audit the log in two parts.",
    )


def _misplaced_boxes(item: SensorAudit) -> LogFinding | None:
    """Return the finding that most detections are near no box, although boxes should be detected."""
    unlabelled, share, sensor = item.unlabelled, item.detections.share, item.log.name
    if unlabelled is None or not item.detections.chances:
        return None
    stated, _ = stated_detection(item.log.config)
    missing = (stated - share.value) * item.detections.chances / unlabelled.scans
    excess = unlabelled.others.bounds()[0] - unlabelled.stated_others
    if not (share.bounds()[1] < ELSEWHERE * stated and excess > ELSEWHERE * missing):
        return None
    return LogFinding(
        kind="elsewhere",
        sensor=sensor,
        title=f"{sensor}: most of its detections are not where the boxes are",
        evidence=f"{100 * share.value:.0f} % of the boxes in its field of view are detected, {100 * stated:.0f} % "
        f"stated; {unlabelled.others.value:.3g} detections a scan are near no box, "
        f"{unlabelled.stated_others:.3g} stated.",
        fix="Check units and signs of azimuth and of the observer's yaw, the mount and the clocks, and audit again: "
        "until then noise and errors cannot be judged.",
        value=share.value,
        ci95=share.bounds(),
    )


def _noise_findings(item: SensorAudit, level: float) -> Iterator[LogFinding]:
    for key, components in sigma_keys(item.log).items():
        noises = [item.noise[i] for i in components]
        # Logarithm of estimated over stated standard deviation, a mean over the components.
        logs = [np.log(max(noise.sigma.value, 1e-300) / noise.stated) for noise in noises]
        relative = [noise.sigma.sigma / max(noise.sigma.value, 1e-300) for noise in noises]
        freedom = min(noise.sigma.freedom for noise in noises)
        ratio = BlockInterval(float(np.mean(logs)), float(np.hypot.reduce(relative)) / len(noises), freedom)
        if ratio.excludes(0.0, level) and abs(ratio.value) > np.log(SIGMA_OFF):
            yield sigma_finding(item.log, key, noises, ratio)


def sigma_keys(log: SensorLog) -> dict[str, list[int]]:
    """Return the scenario keys that state a sensor's noise, each with the indices of its measurement components."""
    components: dict[str, list[int]] = {}
    for i, key in enumerate(log.config.sigma_options):
        components.setdefault(key, []).append(i)
    return components
