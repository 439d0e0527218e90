"""Does an angle that passes pi disturb the tracker?

Turned about the sensor, the same target and the same measurement must lead to the same estimate, turned: unless an
angle is handled wrongly where it passes pi.
"""

from __future__ import annotations

import numpy as np

from trackbench.doctor.bench import Bench, Reply
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.stations import Station
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array
from trackbench.units import wrap_angle

#: Distance from the answer of the turned target, in standard deviations of the prediction.
FAR = 3.0
#: Part of the turned target's answer by which the two may differ, where that answer is felt at all.
LOST, FELT = 0.5, 0.6
#: Difference of logarithms of two variances that are as good as equal.
ALIKE = 0.2
PARTS = (slice(0, 2), slice(2, 4))
#: By how much the target is turned for comparison, rad: well away from where any angle is pi.
TURN = -1.9


def wrapping(bench: Bench) -> Outcome:
    """Nudge the measurement of a target at the azimuth of pi, and of one whose course is pi."""
    outcome = Outcome()
    polar = [name for name, sensor in bench.sensors.items() if sensor.type != "lidar"]
    for angle, stations, asked, question in (
        ("azimuth", bench.stations.axes, polar, "Does a target that crosses the azimuth of pi stay where it is?"),
        ("course", (bench.stations.course_axis,), bench.sensors, "Does a target whose course is pi stay where it is?"),
    ):
        jumps = [
            jump
            for station in stations
            for name in asked
            for by in bench.kinds()
            for jump in _jumps(bench, station, name, by)
        ]
        if not jumps:
            outcome.checks.append(Check(f"{angle}_wrapping", question, None, "no measurement could be tried there"))
            continue
        size, words, sensor = max(jumps, key=lambda jump: jump[0])
        outcome.checks.append(Check(f"{angle}_wrapping", question, size < FAR, words))
        if size >= FAR:
            confidence = 0.97 if size > 5 * FAR else 0.85
            finding = Finding("azimuth_not_wrapped", confidence, words, sensor=sensor, station=stations[0].name)
            outcome.findings.append(finding)
    return outcome


def _jumps(bench: Bench, station: Station, name: str, by: tuple[str, ...]) -> list[tuple[float, str, str]]:
    """How far the answers at a station are from those of the turned target, each with its evidence."""
    here, there = bench.reply(station, name, by), bench.reply(station.turned(TURN), name, by)
    if here is None or there is None or not (here.sound and there.sound):
        return []
    found = []
    for side in (-2.0, 2.0):
        one, other = _moved(here, side), _moved(there, side)
        if one is None or other is None:
            continue
        c, s = np.cos(-TURN), np.sin(-TURN)
        back = np.kron(np.eye(2), np.array([[c, -s], [s, c]]))
        apart, usual = np.abs(one - back @ other) / here.spread, np.abs(back @ other) / here.spread
        size = float(np.max(apart))
        # A gain that is lost there is as wrong as a jump.
        lost = float(np.max(apart)) > LOST * float(np.max(usual)) > LOST * FELT and _alike(here, there)
        found.append((max(size, FAR) if lost else size, _words(here, side, size), name))
    return found


def _alike(here: Reply, there: Reply) -> bool:
    """Whether both know as much of their targets, so that their gains can be compared."""
    ratios = (
        np.trace(here.predicted.covariance[part, part]) / np.trace(there.predicted.covariance[part, part])
        for part in PARTS
    )
    return all(abs(np.log(ratio)) < ALIKE for ratio in ratios)


def _moved(reply: Reply, side: float) -> Array | None:
    """``(4,)`` how much the answer to a measurement beside the expected one differs from that to it."""
    answer, centre = reply.ask(_beside(reply, side)), reply.ask(reply.expected)
    return None if answer is None or centre is None else answer.mean - centre.mean


def _beside(reply: Reply, side: float) -> Array:
    """A measurement some standard deviations to the left, seen from the sensor."""
    if reply.scan.kind != "lidar":
        measurement = reply.expected.copy()
        measurement[1] = wrap_angle(measurement[1] + side * reply.sigma[1])
        return measurement
    dx, dy = reply.predicted.mean[:2] - reply.scan.sensor_pose[:2]
    aside = side * reply.sigma[0] * np.array([-dy, dx, 0.0, 0.0]) / np.hypot(dx, dy)
    target, scan = reply.predicted.mean + aside, reply.scan
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, scan.sensor_velocity)


def _words(reply: Reply, side: float, size: float) -> str:
    measurement = _beside(reply, side)
    if reply.scan.kind == "lidar":
        course = np.arctan2(reply.predicted.mean[3], reply.predicted.mean[2])
        return (
            f"course {course:+.4f} rad: a measurement {abs(side):g} sigma aside moves the estimate by {size:.3g} of "
            "its own standard deviations more than it does the same target turned away from pi"
        )
    return (
        f"predicted azimuth {reply.expected[1]:+.4f} rad, measurement {measurement[1]:+.4f} rad, {abs(side):g} sigma "
        f"beside it (difference {measurement[1] - reply.expected[1]:+.4f}): the estimate moves by {size:.3g} of its "
        "own standard deviations more than that of the same target turned away from pi"
    )
