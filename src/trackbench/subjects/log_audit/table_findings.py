"""Findings on the tables of a log: its clocks, its truth and its observer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from trackbench.base.errors import counted
from trackbench.scenario import Scenario
from trackbench.subjects.log_audit.findings import LogFinding, quantity_text
from trackbench.subjects.log_audit.sensor_log import CLEARLY, Clock, SensorLog, VelocityCheck, reference_noise
from trackbench.truth.config.columns import UNITS
from trackbench.truth.recorded import Drive
from trackbench.truth.recorded.drive import Motion, slope
from trackbench.truth.sources import RecordingTruth

#: The truth of a log, and what was read of its files.
Recorded = tuple[RecordingTruth, Drive]
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
        order, sensor = clock.order, None if clock.name == "truth" else clock.name
        rows, back = counted(order.rows, "row"), order.largest_step_back
        checks = {
            "outside": (
                clock.outside > OUTSIDE * order.rows,
                "many rows are at times without truth",
                f"{clock.outside} of {rows} lie outside the time of the truth.",
                "Check the units of time of the files, and whether their clocks begin alike.",
            ),
            "clock": (
                order.backwards and back > 0.5 * (periods.get(clock.name) or 0.0),
                "time runs backwards",
                f"{order.backwards} of {rows} are earlier than one before them, by up to {quantity_text(back, 's')}.",
                "The rows are read in the order of their times. If the clock was set while it ran, split the log "
                "there: the time offset differs before and after.",
            ),
            "duplicates": (
                order.duplicates,
                "rows are repeated",
                f"{order.duplicates} of {rows} are of an object and a time that came before.",
                "The first of them is read. Remove the others, or give each detection its own time.",
            ),
        }
        for kind, (is_wrong, what, evidence, fix) in checks.items():
            if is_wrong:
                yield LogFinding(kind, sensor, f"{clock.name}: {what}", evidence, fix)


def truth_findings(truth: RecordingTruth, checks: Iterable[VelocityCheck]) -> Iterator[LogFinding]:
    """Velocities that contradict the motion, of all objects of one wrong unit together."""
    alike: dict[str | None, list[VelocityCheck]] = {}
    for check in checks:
        if check.contradicts:
            own = check.unit if check.unit is not None and check.name != "observer" else None
            alike.setdefault(own, []).append(check)
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


def ego_findings(loaded: Scenario, recorded: Recorded, sensors: Mapping[str, SensorLog]) -> Iterator[LogFinding]:
    """Yield the column of the observer's yaw, or else of its yaw rate, that fits in another unit.

    Args:
        loaded: the scenario.
        recorded: the log as it is read.
        sensors: measurements of the log by sensor.
    """
    truth, drive = recorded
    ego, motion = truth.ego, drive.observer
    if ego is None or motion is None or motion.heading is None:
        return
    yaw_unit, rate_unit = (ego.units.get(key) or truth.units.angle for key in ("yaw", "yaw_rate"))
    turned = motion._replace(heading=motion.heading * _other_angle(yaw_unit)[1])
    ratio = _error_ratio(sensors, sensor_logs(loaded, (truth, replace(drive, observer=turned))))
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


def _error_ratio(sensors: Mapping[str, SensorLog], others: Mapping[str, SensorLog]) -> float:
    """Return the errors in one reading of a log over the errors in another: the geometric mean over all components."""
    logarithms: list[float] = []
    for sensor, again in zip(sensors.values(), others.values(), strict=True):
        sizes = np.abs([sensor.residual({}), again.residual({})])
        known = np.isfinite(sizes).all(axis=(0, 1))
        if known.any():
            medians = np.maximum(np.median(sizes[:, :, known], axis=2), 1e-12)
            logarithms += np.log(medians[0] / medians[1]).tolist()
    return float(np.exp(np.mean(logarithms))) if logarithms else 1.0


def _ego_finding(key: str, unit: str, evidence: str) -> LogFinding:
    other = _other_angle(unit)[0]
    title, setting = f"observer: {key.replace('_', ' ')} is in {other}, not {unit}", f"truth.ego.units.{key}"
    fix, changes = f"Set {setting}: {other}.", {setting: other}
    return LogFinding("unit", None, title, evidence, fix, component=key, changes=changes)


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


def sensor_logs(loaded: Scenario, recorded: Recorded) -> dict[str, SensorLog]:
    """Return the measurements of each sensor within the time of the truth."""
    truth, drive = recorded
    reference, sensors = reference_noise(drive), loaded.config.sensors
    return {
        name: SensorLog(name, sensors[name], log, drive, truth, reference, np.ones(len(sensors[name].components)))
        for name, log in drive.clipped().logs.items()
    }
