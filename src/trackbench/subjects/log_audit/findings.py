"""What was found in a log, in words and as changes to its scenario."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.base.errors import counted
from trackbench.subjects.log_audit.blocks import BlockInterval
from trackbench.subjects.log_audit.joint_fit import ErrorEstimate
from trackbench.subjects.log_audit.noise import Detections, ResidualNoise
from trackbench.subjects.log_audit.sensor_log import Clock, SensorLog, VelocityCheck, WrongUnit
from trackbench.truth.recorded.drive import Motion
from trackbench.truth.sources import RecordingTruth

#: A finding changes a measurement by at least this share of the standard deviation of its noise.
EFFECT = 0.1
#: A standard deviation is off if it is wrong by at least this factor.
SIGMA_OFF = 1.1
#: The noise depends on the range if it changes by at least this factor over the middle 80 % of the ranges.
SHAPE = 1.25
#: Probability with which a log without errors gives no finding of an error, a noise or a shape.
FAMILY = 0.95


@dataclass(frozen=True)
class LogFinding:
    """Something that is wrong."""

    kind: str
    """Such as ``time_offset``, ``mount_yaw``, ``bias_range``, ``sigma``, ``unit``, ``sign``, ``gaps``."""
    sensor: str | None
    """None: the truth."""
    title: str
    evidence: str
    fix: str
    value: float | None = None
    """In SI units and radians."""
    ci95: tuple[float, float] | None = None
    unit: str | None = None
    or_else: tuple[str, ...] = ()
    """Errors from which this log does not tell it."""
    component: str | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    """What puts it right in the scenario, by dotted key; empty where the log itself has to be changed."""


#: The units in which angles and times are read.
_READ = {"rad": (180 / np.pi, "°"), "s": (1e3, " ms")}
_WORDS = {
    "time_offset": ("time stamps are {} late", "time stamps are {} early"),
    "mount_yaw": (
        "mount is turned {} to the right of what is stated",
        "mount is turned {} to the left of what is stated",
    ),
    "mount_x": ("mount is {} behind where it is stated", "mount is {} in front of where it is stated"),
    "mount_y": ("mount is {} to the right of where it is stated", "mount is {} to the left of where it is stated"),
}


def spelt(name: str) -> str:
    """An error's name as it is read: "time offset", "bias of range rate"."""
    if name.startswith("bias_"):
        return f"bias of {name.removeprefix('bias_').replace('_', ' ')}"
    return name.replace("_", " ")


def shown(value: float, unit: str, *, signed: bool = False) -> str:
    """A value in the unit in which it is read: degrees for angles, ms for times."""
    factor, name = _READ.get(unit, (1.0, f" {unit}"))
    return f"{value * factor:{'+' if signed else ''}.3g}{name}"


def between(interval: BlockInterval, unit: str) -> str:
    """The 95 % interval in words."""
    return f"95 %: {bounds_shown(interval.bounds(), unit)}"


def bounds_shown(bounds: tuple[float, float], unit: str) -> str:
    """ "0.48 to 0.52 m"."""
    factor, name = _READ.get(unit, (1.0, f" {unit}"))
    low, high = (bound * factor for bound in bounds)
    width = abs(high - low)
    places = int(np.clip(1 - np.floor(np.log10(width)), 0, 6)) if np.isfinite(width) and width > 0 else 3
    return f"{low:.{places}f} to {high:.{places}f}{name}"


def error_finding(sensor: str, estimate: ErrorEstimate, changes: Mapping[str, Any]) -> LogFinding:
    """That a sensor has an error of time, mount or a bias."""
    value, unit = estimate.interval.value, estimate.unit
    size = shown(abs(value), unit)
    if estimate.name in _WORDS:
        title = f"{sensor}: its {_WORDS[estimate.name][int(value > 0)].format(size)}"
    else:
        component = estimate.name.removeprefix("bias_").replace("_", " ")
        title = f"{sensor}: its {component} reads {size} too {'much' if value > 0 else 'little'}"
    evidence = (
        f"{spelt(estimate.name)} {shown(value, unit, signed=True)} "
        f"({between(estimate.interval, unit)}); it moves a measurement by {estimate.effect:.2g} sigma (RMS)."
    )
    if estimate.or_else:
        others = " and ".join(spelt(name) for name in estimate.or_else)
        title += f", or it is its {others}"
        evidence += f" This log cannot tell it from {others}: the value holds if there is none of that."
    for name, bias in estimate.same_as.items():
        equal = shown(bias, "rad" if unit == "rad" else "m", signed=True)
        evidence += f" A {spelt(name)} of {equal} would be the same in any log."
    setting = "; ".join(f"{key}: {new}" for key, new in changes.items())
    fix = f"Set {setting}" if changes else "Correct the log: this format has no key for it"
    return LogFinding(
        kind=estimate.name,
        sensor=sensor,
        title=title,
        evidence=evidence,
        fix=f"{fix}.",
        value=value,
        ci95=estimate.interval.bounds(),
        unit=unit,
        or_else=estimate.or_else,
        changes=dict(changes),
    )


#: Rows of one object of the truth that are further apart than this leave a hole, s, and in usual intervals.
HOLE_S, HOLE = 1.0, 5.0
#: More rows than this share without truth are no matter of the first and the last ones.
OUTSIDE = 0.1


def unit_finding(log: SensorLog, wrong: WrongUnit) -> LogFinding:
    """That a component is in another unit, or counts the other way."""
    name, component = log.name, wrong.component.replace("_", " ")
    unit = log.config.units[log.components.index(wrong.component)]
    same = wrong.fits == wrong.stated
    title = f"{name}: {component} " + ("counts the other way" if same else f"is in {wrong.fits}, not {wrong.stated}")
    if wrong.turned and not same:
        title += ", and counts the other way"
    evidence = (
        f"The spread of measurement minus truth is {shown(wrong.spread[0], unit)} as read, and "
        f"{shown(wrong.spread[1], unit)} so (median)."
    )
    recorded = log.name in log.truth.measurements
    changes = {f"truth.readings.{name}.units.{wrong.component}": wrong.fits} if recorded and not same else {}
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
    """That the noise is not what is stated."""
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
        evidence=f"Standard deviation {shown(value * factor, unit)} (95 %: "
        f"{bounds_shown((low * factor, high * factor), unit)}), stated {shown(stated * factor, unit)}.",
        fix=f"Set sensors.{log.name}.{key}: {new}.",
        value=value * factor,
        ci95=(low * factor, high * factor),
        unit=unit,
        component=noises[0].name,
        changes={f"sensors.{log.name}.{key}": new},
    )


def shape_finding(sensor: str, noise: ResidualNoise, shape: BlockInterval) -> LogFinding:
    """That the noise depends on the range."""
    name = noise.name.replace("_", " ")
    near, far = noise.bands[0], noise.bands[-1]
    return LogFinding(
        kind="sigma_by_range",
        sensor=sensor,
        title=f"{sensor}: the noise of {name} {'grows' if shape.value > 0 else 'falls'} with the range",
        evidence=f"It is proportional to the range to the power {shape.value:.2f} (95 %: {shape.bounds()[0]:.2f} to "
        f"{shape.bounds()[1]:.2f}): {shown(near.interval.value, noise.unit)} at {near.from_m:.0f} to {near.to_m:.0f} m "
        f"and {shown(far.interval.value, noise.unit)} at {far.from_m:.0f} to {far.to_m:.0f} m.",
        fix="A scenario states one sigma for all ranges: take that of the range that matters, or let a tracker of your "
        "own compute R from the range.",
        value=shape.value,
        ci95=shape.bounds(),
        component=noise.name,
    )


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
            back = shown(order.largest_step_back, "s")
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


def silence_finding(sensor: str, detections: Detections) -> LogFinding:
    """That a sensor detected nothing for a time, though objects were in its field of view."""
    return LogFinding(
        kind="silence",
        sensor=sensor,
        title=f"{sensor}: silent for {detections.silent_for_s:.3g} s",
        evidence=f"From {detections.silent_from_s:.2f} s on nothing was detected, though objects were in its field of "
        f"view; elsewhere it detects {100 * detections.share.value:.0f} %.",
        fix="Rows are missing, or something stood before it, or its clock was set forward there. State dropouts in the "
        "scenario, so that its gap is known.",
    )


def outlier_finding(sensor: str, outliers: int, rows: int) -> LogFinding:
    """That more measurements are far from the truth than noise explains."""
    return LogFinding(
        kind="outliers",
        sensor=sensor,
        title=f"{sensor}: {100 * outliers / rows:.1f} % of its measurements are outliers",
        evidence=f"{outliers} of {rows} are further than four sigma from the truth, where normal noise leaves less "
        "than one in a thousand.",
        fix="They are clutter, reflections or of another object: look at the figure. They are left out here, but not "
        "in a run.",
    )


def drift_finding(log: SensorLog, change: BlockInterval) -> LogFinding:
    """That the clock drifts or was set."""
    return LogFinding(
        kind="clock_drift",
        sensor=log.name,
        title=f"{log.name}: its time offset changes by {shown(change.value, 's', signed=True)} during the log",
        evidence=f"{between(change, 's')}, from the first measurement to the last.",
        fix="Its clock drifts or was set while it ran: compare it with that of the truth, or split the log, and audit "
        "again: until then the noise that is found is not the sensor's alone.",
        value=change.value,
        ci95=change.bounds(),
        unit="s",
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
            evidence=f"They differ by {worst.difference:.2g} m/s (median over windows of half a second, {worst.name}); "
            f"the displacement is {worst.scale:.3g} times what the velocity says.",
            fix="; ".join(f"Set {key}: {value}" for key, value in changes.items()) + "."
            if changes
            else "Check unit, frame, sign and time of the velocity; range rates cannot be judged by it.",
            value=worst.difference,
            unit="m/s",
            component=worst.name,
            changes=changes,
        )


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
