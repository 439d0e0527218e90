"""Does the tracker go forward in time as a moving target does?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.doctor.bench import Bench
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.session import Answer, Broken, Session, blind
from trackbench.doctor.stations import Station
from trackbench.types import Array

#: Steps of time by which a tracker is asked to predict, s.
STEPS = (0.002, 0.01, 0.05, 0.1, 0.2, 0.4, 1.0)
#: Error of a step of time, relative to it.
TOLERANCE = 0.1
#: Steps that are short enough to tell a unit even if they are taken for a thousand times as long, s.
SHORT = 0.01
#: How near a factor has to be to that between two units, as the difference of logarithms.
NEAR_UNIT = 0.3
#: Units of time that are taken for one another, and the factor between them.
UNITS = {1e3: "milliseconds", 1e-3: "milliseconds", 1e6: "microseconds", 1e-6: "microseconds", 1e9: "nanoseconds"}
#: Growth of the position's variance by that of the velocity: what it may be relative to constant velocity. Of right
#: trackers it is 0.67 to 1.5, as they turn or accelerate.
GROWTH = (0.45, 2.2)


#: Standard deviation of the velocity over the speed.
KNOWN = 0.35


class Stretch(NamedTuple):
    """One prediction."""

    asked: float
    """s"""
    moved: float
    """Displacement along the velocity over the speed, s."""
    before: float
    """The tracker's step before it, s."""


def prediction(bench: Bench) -> Outcome:
    """Predict over steps of several lengths, after steps of two lengths."""
    question = "Does it move its estimate on by its velocity times the time that has passed?"
    stretches = [
        one
        for by in bench.kinds()[-1:]
        for station in bench.stations.open[:2]
        for one in _stretches(bench, station, by)
    ]
    outcome = Outcome()
    if len(stretches) < len(STEPS):
        outcome.checks.append(Check("prediction", question, None, "there was no moving estimate to predict"))
        return outcome
    asked, moved, before = (np.array(column) for column in zip(*stretches, strict=True))
    wrong = np.abs(moved - asked) > TOLERANCE * np.maximum(asked, 0.02)
    ratios = moved / asked
    text = (
        f"steps of {asked.min():g} to {asked.max():g} s move it {ratios.min():.3g} to {ratios.max():.3g} times as far"
    )
    passed = float(np.mean(wrong)) < 0.1
    outcome.checks.append(Check("prediction", question, passed, text))
    if passed:
        return outcome
    ratio = float(np.median(ratios))
    # Over a step that is far too long a turning model goes round.
    unit = _unit(float(np.median(ratios[asked <= SHORT])))
    factor: float | None = None
    if np.allclose(moved, before, rtol=TOLERANCE, atol=2e-3):
        said = "it moves by the step before: after steps of " + " and ".join(f"{b:g}" for b in np.unique(before)) + " s"
        said += f", a prediction over {asked[-1]:g} s goes {moved[-1]:.3g} s far"
    elif np.ptp(moved) < TOLERANCE * float(np.abs(moved).max()) + 1e-6:
        said = f"it moves by the same {np.median(moved):.3g} s whether {asked.min():g} or {asked.max():g} s have passed"
    elif unit is not None:
        factor, name = unit
        said = f"a prediction over {asked[0]:g} s moves the estimate as far as {moved[0]:.3g} s would: time in {name} "
        said += f"is taken for seconds, or seconds for {name}"
    elif float(np.std(ratios)) < TOLERANCE * abs(ratio):
        factor = ratio
        said = f"a prediction over {asked[-1]:g} s moves the estimate as far as {moved[-1]:.3g} s would"
    else:
        return outcome
    outcome.findings.append(Finding("wrong_dt", 0.97, said, factor=factor, station=bench.stations.open[0].name))
    return outcome


def _unit(ratio: float) -> tuple[float, str] | None:
    """The factor between two units of time that a ratio is near, and the unit's name."""
    near = ((size, name) for size, name in UNITS.items() if ratio > 0.0 and abs(np.log(ratio / size)) < NEAR_UNIT)
    return next(near, None)


def _stretches(bench: Bench, station: Station, by: tuple[str, ...]) -> list[Stretch]:
    session = bench.followed(station, by)
    if session is None:
        return []
    name = by[0]
    start = blind(station.scan(name, bench.sensors[name], 0.0))
    found = []
    try:
        for before in (0.05, 0.15):
            ready = session.ahead()
            ready.step(start)
            first = ready.step(blind(station.scan(name, bench.sensors[name], before)))
            for asked in STEPS:
                later = ready.peek(blind(station.scan(name, bench.sensors[name], before + asked)))
                if first is None or later is None or not (first.finite and later.finite):
                    continue
                speed = float(np.hypot(*first.mean[2:]))
                gone = (later.mean - first.mean)[:2]
                # A velocity in another unit may be small.
                if speed > 1.0 or (speed > 1e-6 and np.hypot(*gone) > 0.05):
                    along = gone @ first.mean[2:] / speed**2
                    found.append(Stretch(asked, float(along), before))
    except Broken as broken:
        bench.broken.append((station.name, broken))
    return found


def spreading(bench: Bench) -> Outcome:
    """Early in a track, where the velocity is uncertain: does the covariance of the position grow by it?

    Of any motion model ``d P_pp = t (P_pv + P_vp) + t^2 P_vv`` to first order, and ``d P_pv = t P_vv``.
    """
    question = "Does the uncertainty of the velocity become one of the position?"
    ratios: list[tuple[float, float, Station]] = []
    for station in bench.stations.open[:4]:
        for name in bench.sensors:
            ratios += [(*ratio, station) for ratio in _growth(bench, station, name)]
    outcome = Outcome()
    if not ratios:
        outcome.checks.append(Check("spreading", question, None, "there was no estimate early enough"))
        return outcome
    least, most = np.quantile([r[0] for r in ratios], 0.3), np.quantile([r[1] for r in ratios], 0.7)
    off = [r for r in ratios if r[0] < GROWTH[0] or r[1] > GROWTH[1]]
    text = f"it becomes {least:.2g} to {most:.2g} times the right covariance of position and velocity (30 % points)"
    passed = len(off) < 0.3 * len(ratios)
    outcome.checks.append(Check("spreading", question, passed, text))
    if not passed:
        worst = min(off, key=lambda r: r[0])
        said = (
            f"the predicted covariance of position and velocity grows by {worst[0]:.2g} to {worst[1]:.2g} of what the "
            "uncertain velocity causes: an entry of the transition's Jacobian (d px / d vx = dt) is wrong"
        )
        outcome.findings.append(Finding("jacobian_wrong", 0.9, said, station=worst[2].name))
    return outcome


def _growth(bench: Bench, station: Station, name: str) -> list[tuple[float, float]]:
    sensor, session, found = bench.sensors[name], Session(bench.make), []
    rate = min(sensor.rate_hz, 20.0)
    try:
        for k in range(12):
            session.step(station.scan(name, sensor, k / rate - 2.0))
            now = session.peek(blind(station.scan(name, sensor, k / rate - 2.0)))
            then = session.peek(blind(station.scan(name, sensor, k / rate - 1.9)))
            if k >= 4 and now is not None and then is not None and now.finite and then.finite and _known(now):
                found.append(_ratios(now, then, 0.1))
    except Broken as broken:
        bench.broken.append((station.name, broken))
    return found


def _known(answer: Answer) -> bool:
    """Whether the direction of motion is known so well that a turning model is as good as linear."""
    return float(np.sqrt(np.abs(np.trace(answer.covariance[2:, 2:])))) < KNOWN * float(np.hypot(*answer.mean[2:]))


def _ratios(now: Answer, then: Answer, step: float) -> tuple[float, float]:
    """Least and largest growth of the covariance of position and velocity along two axes.

    Relative to what the velocity's variance at the beginning causes at least, and its mean at most: with white
    acceleration, constant over the step or not, the latter is exact.
    """
    p, after = now.covariance, then.covariance
    axes: Array = np.linalg.eigh(0.5 * (p[2:, 2:] + p[2:, 2:].T))[1]
    least, most = [], []
    for u in axes.T:
        grown, before, later = (float(u @ block @ u) for block in ((after - p)[:2, 2:], p[2:, 2:], after[2:, 2:]))
        least.append(grown / (step * before))
        most.append(grown / (step * (before + later) / 2))
    return min(least), max(most)
