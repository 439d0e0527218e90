"""How does a track begin?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.doctor.bench import Bench
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.session import Answer, Broken, Session
from trackbench.doctor.stations import Carrier, Station
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array, Scan

#: Mean normalised square of the first errors over its expectation: a prior with half the spread of the targets has 4.
OVERCONFIDENT = 6.0
#: Tracks begun to see it.
STARTS = 60
#: Scans after which the first error is looked at again.
SCANS = 6


def first_position(bench: Bench) -> Outcome:
    """Begin tracks without noise at every station with each sensor, and see where they are."""
    outcome = Outcome()
    for name, sensor in bench.sensors.items():
        begun = [
            one
            for station in (*bench.stations.open, *bench.stations.moving)
            if (one := _begin(bench, station, name)) is not None
        ]
        question = f"Does a track that begins with {name} begin where the target is?"
        if not begun:
            outcome.checks.append(Check(f"start.{name}", question, None, "no track began"))
            continue
        off = [one for one in begun if _error(one) > _allowed(one)]
        worst = max(begun, key=_error)
        text = f"{len(off)} of {len(begun)} tracks begin elsewhere; the worst is {_error(worst):.3g} m off"
        outcome.checks.append(Check(f"start.{name}", question, not off, text))
        if sensor.type != "lidar" and off:
            outcome.findings += _polar(name, begun)
        outcome.findings += _reversed(name, begun)
    return outcome


class Begun(NamedTuple):
    """A track at its first estimate."""

    station: Station
    scan: Scan
    answer: Answer
    truth: Array
    """``(4,)`` at that time."""


def _begin(bench: Bench, station: Station, name: str) -> Begun | None:
    sensor, session = bench.sensors[name], Session(bench.make)
    rate = min(sensor.rate_hz, 20.0)
    try:
        for k in range(SCANS):
            scan = station.scan(name, sensor, k / rate)
            answer = session.step(scan)
            if answer is not None:
                return Begun(station, scan, answer, station.truth(k / rate)) if answer.finite else None
    except Broken as broken:
        bench.broken.append((station.name, broken))
    return None


def _error(begun: Begun) -> float:
    return float(np.hypot(*(begun.answer.mean - begun.truth)[:2]))


def _allowed(begun: Begun) -> float:
    position = SENSOR_MODELS[begun.scan.kind].position(begun.scan).covariance
    return 3.0 * float(np.sqrt(np.trace(position)))


def _polar(name: str, begun: list[Begun]) -> list[Finding]:
    """The first two components of the measurement where the position should be."""
    same = [one for one in begun if np.allclose(one.answer.mean[:2], one.scan.measurement[:2], atol=0.2)]
    moved = [
        one
        for one in begun
        if np.allclose(one.answer.mean[:2] - one.scan.sensor_pose[:2], one.scan.measurement[:2], atol=0.2)
    ]
    best = max(same, moved, key=len)
    if len(best) < 0.7 * len(begun):
        return []
    station, scan, answer, truth = best[0]
    text = (
        f"a track that begins with range {scan.measurement[0]:.4g} m and azimuth {scan.measurement[1]:.4g} rad begins "
        f"at px {answer.mean[0]:.4g}, py {answer.mean[1]:.4g}, where the target is at {truth[0]:.4g}, {truth[1]:.4g} "
        f"({len(best)} of {len(begun)} tracks)"
    )
    return [Finding("polar_start", 0.98, text, sensor=name, station=station.name)]


def _reversed(name: str, begun: list[Begun]) -> list[Finding]:
    """Velocities that begin the wrong way round where, and only where, they point backward."""
    told = [one for one in begun if np.hypot(*one.answer.mean[2:]) > 2.0 and _error(one) < 3 * _allowed(one)]
    wrong = [
        one for one in told if float(one.answer.mean[2:] @ one.truth[2:]) < -0.5 * float(one.truth[2:] @ one.truth[2:])
    ]
    if len(told) < 4 or len(wrong) < 2 or any(one.truth[2] > 0.0 for one in wrong):
        return []
    if any(one.truth[2] < 0.0 and one not in wrong for one in told):
        return []
    station, _, answer, truth = wrong[0]
    text = (
        f"a target with the velocity {truth[2]:.3g}, {truth[3]:.3g} m/s begins with {answer.mean[2]:.3g}, "
        f"{answer.mean[3]:.3g}: all {len(wrong)} that move toward -x begin the wrong way round, the other "
        f"{len(told) - len(wrong)} do not"
    )
    return [Finding("arctan_quadrant", 0.95, text, sensor=name, station=station.name)]


def confidence(bench: Bench) -> Outcome:
    """Begin tracks of targets of many velocities with noise, and hold the first errors against what is claimed."""
    question = "Is the first covariance as large as the first errors?"
    random = np.random.default_rng([bench.seed, 0])
    squares: dict[str, list[Array]] = {name: [] for name in bench.sensors}
    for _ in range(STARTS):
        bearing, course = random.uniform(-np.pi, np.pi, 2)
        distance, speed = random.uniform(15.0, 60.0), random.uniform(3.0, 20.0)
        target = (
            distance * np.cos(bearing),
            distance * np.sin(bearing),
            speed * np.cos(course),
            speed * np.sin(course),
        )
        station = Station("start", "a target seen for the first time", target, Carrier())
        for name in bench.sensors:
            square = _first_square(bench, station, name, random)
            if square is not None:
                squares[name].append(square)
    known = {name: np.array(values) for name, values in squares.items() if len(values) > STARTS // 2}
    if not known:
        return Outcome([Check("start_confidence", question, None, "no track began")])
    outcome = Outcome()
    means = {name: (np.mean(values, axis=0), np.median(values, axis=0)) for name, values in known.items()}
    text = "; ".join(
        f"{name}: mean normalised square {mean[0]:.3g} of the first position and {mean[1]:.3g} of the first velocity, "
        "2 each if honest"
        for name, (mean, _) in means.items()
    )
    over = {name: max(mean / 2) for name, (mean, median) in means.items() if max(median / 1.39) > OVERCONFIDENT}
    outcome.checks.append(Check("start_confidence", question, not over, text))
    if over:
        name = max(over, key=lambda item: over[item])
        outcome.findings.append(
            Finding("overconfident_start", 0.9, text, factor=1 / over[name], station=bench.stations.open[0].name)
        )
    return outcome


def _first_square(bench: Bench, station: Station, name: str, random: np.random.Generator) -> Array | None:
    """``(2,)`` normalised squares of the errors of the first position and of the first velocity."""
    sensor, session = bench.sensors[name], Session(bench.make)
    rate = min(sensor.rate_hz, 20.0)
    try:
        for k in range(SCANS):
            scan = station.scan(name, sensor, k / rate)
            noise = np.sqrt(np.diag(scan.noise_covariance)) * random.standard_normal(len(scan.measurement))
            answer = session.step(scan._replace(measurement=scan.measurement + noise))
            bench.vitals.note(answer, scan, "start")
            if answer is not None:
                if not answer.finite:
                    return None
                error, p = answer.mean - station.truth(k / rate), 0.5 * (answer.covariance + answer.covariance.T)
                parts = (slice(0, 2), slice(2, 4))
                return np.array([error[part] @ np.linalg.pinv(p[part, part]) @ error[part] for part in parts])
    except Broken as broken:
        bench.broken.append((station.name, broken))
    return None
