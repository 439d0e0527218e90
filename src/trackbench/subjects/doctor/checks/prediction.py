"""Does the tracker predict the motion of a target, and the growth of its uncertainty, over the right time?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.output_checks import least_eigenvalue, scaled_covariances
from trackbench.subjects.doctor.probes import Probe, probe_rate
from trackbench.subjects.doctor.session import TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, linearises
from trackbench.subjects.doctor.units_ratio import FAR_APART, conversion

#: Time steps of the predictions, s.
STEPS = (0.002, 0.01, 0.05, 0.1, 0.2, 0.4, 1.0)
#: Error of a time step, relative to it.
TOLERANCE = 0.1
#: Steps up to this are short enough to identify a unit even if they are taken a thousand times too long, s.
SHORT = 0.01
#: Longest time of motion of an estimate that does not move, s.
STILL = 1e-3
#: Turn of the velocity, rad, and change of the speed, relative to it, up to which a prediction is straight.
STRAIGHT = 0.05
#: Share of the predictions that have to be.
MOST = 0.8
#: Time after which a measurement shows whether there is a prediction to it, s, and the share of the motion in it by
#: which the estimate may be off then.
LATER, MISSED = 0.4, 0.25
#: Bounds of the growth of the position's covariance, relative to constant velocity. Correct trackers have 0.67 to 1.5,
#: because their models turn or accelerate.
GROWTH = (0.45, 2.2)
#: The same where tracks are settled; there they have 1.1 to 1.95.
SETTLED_GROWTH = (0.7, 2.5)
#: Time over which the growth is examined, s.
SPREAD_OVER = 0.1
#: First of the scans of a track after which it is examined.
SETTLED = 4
#: Standard deviation of the velocity over the speed below which the growth is examined.
KNOWN = 0.35


class Spread(NamedTuple):
    """How much the covariance of position and velocity grows over that which the uncertain velocity causes."""

    least: float
    """Along one axis."""
    most: float
    """Along the other."""
    block: Array
    """``(2, 2)`` d position / d velocity, s."""
    probe: Probe


class PredictedStep(NamedTuple):
    """One prediction."""

    step: float
    """s"""
    moved: float
    """Displacement along the velocity over the speed, s: the step that the tracker used."""
    previous: float
    """The step before it, s."""
    before: Estimate
    after: Estimate

    @property
    def straight(self) -> bool:
        """Whether the velocity stays as it is, and the estimate moves along it."""
        velocity, later = self.before.mean[2:], self.after.mean[2:]
        across = np.array([-velocity[1], velocity[0]]) / (velocity @ velocity)
        aside = abs(float(across @ (self.after.mean - self.before.mean)[:2]))
        apart = np.linalg.norm(later - velocity) / np.linalg.norm(velocity)
        return bool(apart < STRAIGHT and aside < STRAIGHT * max(abs(self.moved), STILL))


@doctor_check(
    Question("prediction", "Is the estimate predicted by its velocity times the time step?", misses=True),
    place=80,
    of_filters=True,
    faults={
        "wrong_dt": KnownFault(
            "the time step is wrong",
            "Where the time since the last scan is computed and stored.",
            "dt = scan.time - time of the state, in s, at every scan, missed ones too; store the new time with the "
            "state.",
            Role("motion", rank=20, causes="measured growth time_offset", drive="uneven_steps"),
        ),
        "missed_scan_not_predicted": KnownFault(
            "there is no prediction at a missed scan",
            "Where a scan without a measurement (scan.valid is False) returns early.",
            "Predict to scan.time at every scan, and leave out only the update where there is no measurement.",
            Role("exact", rank=17, causes="stepped", drive="uneven_steps"),
        ),
        "velocity_unit": KnownFault(
            "the velocity is in another unit than m/s",
            "Where the estimate is returned, or where the velocity is made from positions and times.",
            "Return m/s; the state may have any unit, if it is converted there, with the covariance.",
            Role(
                "motion",
                rank=6,
                causes="stepped wrong_dt",
                always="ego doppler_sign speed_for_range_rate",
                drive="tangential_pass",
            ),
        ),
    },
)
def motion_prediction(tracker: TrackerUnderTest) -> PartResult:
    """Predict over steps of several lengths, each after previous steps of two lengths."""
    steps = [one for probe in tracker.probes.general[:2] for one in _predicted_steps(tracker, probe)]
    if len(steps) < len(STEPS):
        return PartResult().add("prediction", None, "there was no moving estimate to predict")
    step, moved = (np.array([one[i] for one in steps]) for i in range(2))
    wrong = np.abs(moved - step) > TOLERANCE * np.maximum(step, 0.02)
    ratios = moved / step
    text = (
        f"over steps of {step.min():g} to {step.max():g} s the estimate moves {ratios.min():.3g} to {ratios.max():.3g} "
        "times as far as its velocity says"
    )
    passed = float(np.mean(wrong)) < 0.1
    finding = None if passed else _explained(tracker, steps)
    return PartResult().add("prediction", passed, text, finding)


def _explained(tracker: TrackerUnderTest, steps: Sequence[PredictedStep]) -> Finding | None:
    """What fits the displacements of all predictions."""
    step, moved, previous = (np.array([one[i] for one in steps]) for i in range(3))
    ratios, shown_by = moved / step, tracker.probes.general[0].name
    ratio = float(np.median(ratios))
    # Over a step that is far too long a turning model goes round in circles.
    time = conversion(float(np.median(ratios[step <= SHORT])), FAR_APART, quantities=("time",))
    if np.allclose(moved, previous, rtol=TOLERANCE, atol=2e-3):
        text = (
            f"the tracker uses the previous time step: after steps of "
            f"{' and '.join(f'{b:g}' for b in np.unique(previous))} s, a prediction over {step[-1]:g} s moves the "
            f"estimate by {moved[-1]:.3g} s times its velocity"
        )
        return Finding("wrong_dt", 0.97, text, shown_by=shown_by)
    if np.allclose(moved, step + previous, rtol=TOLERANCE, atol=2e-3):
        text = (
            f"a prediction over {step[-1]:g} s moves the estimate by {moved[-1]:.3g} s times its velocity: the "
            f"{previous[-1]:g} s before it, which were predicted at a missed scan, are predicted again"
        )
        return Finding("wrong_dt", 0.97, text, shown_by=shown_by)
    error = _error_at_measurements(tracker) if float(np.abs(moved).max()) < STILL else None
    if error is not None:
        text = (
            f"a missed scan {step.max():g} s later leaves the estimate where it is, while after a measurement "
            f"{LATER:g} s later it is at the target (error {error:.2g} m)"
        )
        return Finding("missed_scan_not_predicted", 0.98, text, shown_by="uneven_steps")
    if np.ptp(moved) < TOLERANCE * float(np.abs(moved).max()) + 1e-6:
        text = (
            f"the estimate moves by {np.median(moved):.3g} s times its velocity, whether the step is {step.min():g} or "
            f"{step.max():g} s long"
        )
        return Finding(
            "wrong_dt", 0.97, text, factor=float(np.median(moved)) / float(np.median(step)), shown_by=shown_by
        )
    if time is not None:
        text = (
            f"a prediction over {step[0]:g} s moves the estimate by {moved[0]:.3g} s times its velocity: "
            f"{time.unit.name} and seconds are confused"
        )
        return Finding("wrong_dt", 0.97, text, factor=time.exact, shown_by=shown_by)
    if not float(np.std(ratios)) < TOLERANCE * abs(ratio):
        return _other_time(steps)
    velocity = conversion(1 / ratio, float(np.std(ratios)) / abs(ratio), quantities=("speed", "length"))
    if velocity is not None:
        text = (
            f"over {step[-1]:g} s the position moves {ratio:.4g} times as far as the velocity says, which is "
            f"{1 / ratio:.4g} times as large: {velocity.words}"
        )
        return Finding("velocity_unit", 0.97, text, factor=1 / ratio, shown_by=shown_by)
    text = f"a prediction over {step[-1]:g} s moves the estimate by {moved[-1]:.3g} s times its velocity"
    return Finding("wrong_dt", 0.97, text, factor=ratio, shown_by=shown_by)


def _other_time(steps: Sequence[PredictedStep]) -> Finding | None:
    """Straight motion along the velocity, over other times than the steps: cut, rounded, or in whole seconds."""
    off = [step for step in steps if abs(step.moved - step.step) > TOLERANCE * max(step.step, 0.02)]
    if np.mean([step.straight for step in steps]) < MOST:
        return None
    moved = {step.step: f"{step.step:g} s by {step.moved:.3g} s" for step in off}
    text = f"predictions move the estimate along its velocity, and over other times: over {', '.join(moved.values())}"
    return Finding("wrong_dt", 0.95, text, shown_by="uneven_steps")


def _error_at_measurements(tracker: TrackerUnderTest) -> float | None:
    """The position error after a measurement without noise some time later, m; None unless it was predicted to it."""
    errors = []
    sensor_set = tracker.sensor_sets()[-1]
    for probe in tracker.probes.general[:2]:
        session = tracker.session_at(probe, sensor_set)
        scan = tracker.scan(probe, sensor_set[0], LATER)
        estimate = tracker.peek(session, scan, probe.name)
        if estimate is None or not finite(estimate):
            return None
        away = estimate.mean - probe.truth(LATER)
        speed = float(np.hypot(*probe.target[2:]))
        # Without a prediction the position lags, and the lag is taken for speed.
        if np.hypot(*away[:2]) > MISSED * LATER * speed or np.hypot(*away[2:]) > MISSED * speed:
            return None
        errors.append(float(np.hypot(*away[:2])))
    return max(errors)


def _predicted_steps(tracker: TrackerUnderTest, probe: Probe) -> list[PredictedStep]:
    at_probe, name = tracker.session_of_most(probe), next(iter(tracker.sensors))
    found: list[PredictedStep] = []
    if at_probe is None:
        return found
    with tracker.recording_failures(probe.name):
        for previous in (0.05, 0.15):
            session = at_probe.copy()
            session.step(tracker.missed(probe, name, 0.0))
            first = session.step(tracker.missed(probe, name, previous))
            for step in STEPS:
                later = session.peek(tracker.missed(probe, name, previous + step))
                if first is None or later is None or not (finite(first) and finite(later)):
                    continue
                speed = float(np.hypot(*first.mean[2:]))
                displacement = (later.mean - first.mean)[:2]
                # A velocity in another unit may be small.
                if speed > 1.0 or (speed > 1e-6 and np.hypot(*displacement) > 0.05):
                    moved = displacement @ first.mean[2:] / speed**2
                    found.append(PredictedStep(step, float(moved), previous, first, later))
    return found


@doctor_check(
    Question("spreading", "Does the uncertainty of the velocity spread to the position?", misses=True),
    place=100,
    of_filters=True,
    of_own_covariance=True,
)
def spreading(tracker: TrackerUnderTest) -> PartResult:
    """Early in a track and later, compare the growth of the position's covariance with the uncertainty of the velocity.

    Of any motion model ``d P_pp = t (P_pv + P_vp) + t^2 P_vv`` to first order, and ``d P_pv = t P_vv``.
    """
    early = [
        Spread(*ratio, probe)
        for probe in tracker.probes.general[:4]
        for name in tracker.sensors
        for ratio in _growth(tracker, probe, name)
    ]
    settled = [spread for probe in tracker.probes.general if (spread := _settled_growth(tracker, probe)) is not None]
    if not early and not settled:
        return PartResult().add("spreading", None, "there was no estimate early enough")
    off = list[Spread]()
    for spreads, bounds, share in ((early, GROWTH, 0.3), (settled, SETTLED_GROWTH, MOST)):
        beyond = [spread for spread in spreads if spread.least < bounds[0] or spread.most > bounds[1]]
        off += beyond if len(beyond) >= share * len(spreads) else []
    ratios = early or settled
    least, most = np.quantile([of.least for of in ratios], 0.3), np.quantile([of.most for of in ratios], 0.7)
    text = (
        "the covariance of position and velocity grows as much as the uncertain velocity causes, times at least "
        f"{least:.2g} in 70 % of the trials and at most {most:.2g} in 70 %"
    )
    if not off:
        return PartResult().add("spreading", True, text)
    low, high, _, probe = min(off, key=lambda spread: spread.least)
    points = tracker.once(linearises) is False
    where = "a moved sigma point" if points else "an entry of the transition's Jacobian"
    evidence = (
        f"the covariance of position and velocity grows {low:.2g} to {high:.2g} times as much as the uncertain "
        f"velocity causes: {where} (d px / d vx = dt) is wrong"
    )
    fault = "predicted_covariance_wrong" if points else "jacobian_wrong"
    finding = Finding(fault, 0.9, evidence, shown_by=probe.name)
    return PartResult().add("spreading", False, text, finding)


def _settled_growth(tracker: TrackerUnderTest, probe: Probe) -> Spread | None:
    """From the estimate at a probe on."""
    session, name = tracker.session_of_most(probe), next(iter(tracker.sensors))
    now, then = (tracker.peek(session, tracker.missed(probe, name, time), probe.name) for time in (0.0, SPREAD_OVER))
    if now is None or then is None or not (finite(now) and finite(then) and _known(now)):
        return None
    return Spread(*_ratios(now, then, SPREAD_OVER), _block(now, then), probe)


def _block(now: Estimate, then: Estimate) -> Array:
    """``(2, 2)`` d position / d velocity, with the mean covariance of the velocity over the step."""
    grown = (then.covariance - now.covariance)[:2, 2:]
    return np.asarray(grown @ np.linalg.pinv(0.5 * (now.covariance + then.covariance)[2:, 2:]))


def _growth(tracker: TrackerUnderTest, probe: Probe, name: str) -> list[tuple[float, float, Array]]:
    sensor, session = tracker.sensors[name], TrackerSession(tracker.make)
    rate = probe_rate(sensor)
    found: list[tuple[float, float, Array]] = []
    with tracker.recording_failures(probe.name):
        for k in range(12):
            session.step(probe.scan(name, sensor, k / rate - 2.0))
            if k < SETTLED:
                continue
            now = session.peek(empty_scan(probe.scan(name, sensor, k / rate - 2.0)))
            then = session.peek(empty_scan(probe.scan(name, sensor, k / rate - 2.0 + SPREAD_OVER)))
            if now is not None and then is not None and finite(now) and finite(then) and _known(now):
                found.append((*_ratios(now, then, SPREAD_OVER), _block(now, then)))
    return found


def _known(estimate: Estimate) -> bool:
    """Whether the direction of motion is known well enough for a turning model to be nearly linear.

    Nothing follows from a covariance that is indefinite.
    """
    if least_eigenvalue(scaled_covariances(estimate.covariance)) < 0.0:
        return False
    variances = np.abs(np.linalg.eigvalsh(linalg.symmetrise(estimate.covariance[2:, 2:])))
    return variances.min() > 0.0 and float(np.sqrt(variances.sum())) < KNOWN * float(np.hypot(*estimate.mean[2:]))


def _ratios(now: Estimate, then: Estimate, step: float) -> tuple[float, float]:
    """Smallest and largest growth of the covariance of position and velocity along two axes.

    The smallest is relative to what the variance of the velocity at the beginning causes, the largest to what its mean
    over the step does: the latter is exact for a white acceleration, constant over the step or not.
    """
    p, after = now.covariance, then.covariance
    axes: Array = np.linalg.eigh(0.5 * (p[2:, 2:] + p[2:, 2:].T))[1]
    least, most = [], []
    for u in axes.T:
        grown, before, later = (float(u @ block @ u) for block in ((after - p)[:2, 2:], p[2:, 2:], after[2:, 2:]))
        least.append(grown / (step * before))
        most.append(grown / (step * (before + later) / 2))
    return min(least), max(most)
