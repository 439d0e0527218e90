"""The findings on a log's clocks, truth and observer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from trackbench.base.errors import counted
from trackbench.scenario import Scenario
from trackbench.subjects.log_audit.findings import LogFinding, quantity_text
from trackbench.subjects.log_audit.sensor_log import CLEARLY, Clock, SensorLog, VelocityCheck, reference_noise
from trackbench.truth.config.columns import UNITS, Column
from trackbench.truth.recorded import Drive
from trackbench.truth.recorded.drive import Motion, slope
from trackbench.truth.sources import RecordingTruth

#: Truth of a log as configured, and as read from its files.
Recorded = tuple[RecordingTruth, Drive]
#: Smallest hole between two rows of an object of the truth, s, and in median intervals; both must be exceeded.
HOLE_S, HOLE = 1.0, 5.0
#: Largest share of rows outside the time of the truth that is no finding.
OUTSIDE = 0.1
#: Correlation of the yaw rate with the yaw's slope above which the two may differ in their unit alone.
ALIKE = 0.5


def clock_findings(clocks: Iterable[Clock], periods: Mapping[str, float | None]) -> Iterator[LogFinding]:
    """Yield findings on rows that are out of order, repeated, or at times without truth.

    Args:
        clocks: clocks of the truth and of the sensors.
        periods: scan periods of the sensors, s; rows within half a period may stand in any order.
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
                f"{order.backwards} of {rows} are earlier than a row before them, by up to {quantity_text(back, 's')}.",
                "The rows are read in the order of their times. If the clock was set while it ran, split the log "
                "there: the time offset differs before and after.",
            ),
            "duplicates": (
                order.duplicates,
                "rows are repeated",
                f"{order.duplicates} of {rows} repeat the object and time of an earlier row.",
                "The first of them is read. Remove the others, or give each detection its own time.",
            ),
        }
        for kind, (is_wrong, what, evidence, fix) in checks.items():
            if is_wrong:
                yield LogFinding(kind, sensor, f"{clock.name}: {what}", evidence, fix)


def truth_findings(truth: RecordingTruth, checks: Iterable[VelocityCheck]) -> Iterator[LogFinding]:
    """Yield a finding for each unit that explains wrong velocities, and one for all that no unit explains."""
    by_unit: dict[str | None, list[VelocityCheck]] = {}
    for check in checks:
        if check.contradicts:
            fitting_unit = check.unit if check.unit is not None and check.name != "observer" else None
            by_unit.setdefault(fitting_unit, []).append(check)
    for unit, faults in by_unit.items():
        changes = {}
        if unit is not None and truth.columns is not None:
            stated, keys = truth.columns.stated, ("vx", "vy", "speed")
            changes = {f"truth.columns.{key}": f"{stated[key].name}:{unit}" for key in keys if key in stated}
        names, worst = ", ".join(check.name for check in faults), max(faults, key=lambda check: check.difference)
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
    """Yield a finding if the observer's yaw, or else its yaw rate, fits in another unit."""
    truth, drive = recorded
    ego, motion = truth.ego, drive.observer
    if ego is None or motion is None or motion.heading is None:
        return
    columns = ego.stated
    turned = motion._replace(heading=motion.heading * _other_angle(columns["yaw"].unit)[1])
    ratio = _error_ratio(sensors, sensor_logs(loaded, (truth, replace(drive, observer=turned))))
    if ratio > CLEARLY:
        evidence = f"As read, the errors of the sensors are {ratio:.2g} times as large (median)."
        yield _ego_finding("yaw", columns["yaw"], evidence)
    elif motion.yaw_rate is not None:
        yaw_slope, rate = slope(np.unwrap(motion.heading), motion.time), motion.yaw_rate
        product, square = float(yaw_slope @ rate), float(rate @ rate)
        correlation = product / max(np.sqrt(square * float(yaw_slope @ yaw_slope)), 1e-300)
        scale = product / max(square, 1e-300)
        if correlation > ALIKE and abs(np.log(scale / _other_angle(columns["yaw_rate"].unit)[1])) < np.log(CLEARLY):
            evidence = f"The yaw changes {scale:.3g} times as fast as it says."
            yield _ego_finding("yaw_rate", columns["yaw_rate"], evidence)


def _other_angle(unit: str) -> tuple[str, float]:
    """Return the other unit of an angle, and the factor that corrects a value read in the wrong unit."""
    other = "deg" if unit == "rad" else "rad"
    return other, UNITS["angle"][other] / UNITS["angle"][unit]


def _error_ratio(sensors: Mapping[str, SensorLog], others: Mapping[str, SensorLog]) -> float:
    """Return the ratio of the sensors' errors in two readings of a log, a geometric mean over all components."""
    logarithms: list[float] = []
    for sensor, other in zip(sensors.values(), others.values(), strict=True):
        sizes = np.abs([sensor.residual({}), other.residual({})])
        known = np.isfinite(sizes).all(axis=(0, 1))
        if known.any():
            medians = np.maximum(np.median(sizes[:, :, known], axis=2), 1e-12)
            logarithms += np.log(medians[0] / medians[1]).tolist()
    return float(np.exp(np.mean(logarithms))) if logarithms else 1.0


def _ego_finding(key: str, column: Column, evidence: str) -> LogFinding:
    other = _other_angle(column.unit)[0]
    title, setting = f"observer: {key.replace('_', ' ')} is in {other}, not {column.unit}", f"truth.ego.{key}"
    fix, changes = f"Set {setting}: {column.name}:{other}.", {setting: f"{column.name}:{other}"}
    return LogFinding("unit", None, title, evidence, fix, component=key, changes=changes)


def hole_findings(motions: Mapping[str, Motion]) -> Iterator[LogFinding]:
    """Yield a finding on each object whose truth has gaps in time, which are bridged by a straight line."""
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
