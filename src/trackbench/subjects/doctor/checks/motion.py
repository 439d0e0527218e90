"""Does a prediction move the mean along the tracker's own velocity, and leave the covariance where no time passes?

A prediction over almost no time leaves mean and covariance as they are, whatever the models. Sigma points that are no
root of the covariance change its shape, and points too near or too far for their weights scale it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import COMMON_STATE, Array, Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.findings import PROVEN, Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.matrices import best_multiple
from trackbench.subjects.doctor.output_checks import least_eigenvalue, scaled_covariances
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, linearises

#: Times of predictions, s: over the first no motion changes a velocity, over the second no motion turns far.
INSTANT, STEP = 0.002, 0.1
#: Least share of the motion across the velocity that is a fault, and least change of the velocity, relative to it.
ASIDE, CHANGED = 0.15, 0.1
#: Largest error of a motion that is a sum of velocities, relative to the motion.
EXACT = 0.01
#: Ratio of km/h and m/s, and largest error of its logarithm.
KMH, UNIT = 3.6, 0.03
#: Speed up to which an estimate is at rest, m/s, and least number of predictions.
STILL, LEAST = 0.1, 3
#: Time from a first estimate to a missed scan, s: before it position and velocity are not correlated. Time of the
#: prediction after that scan, s: 0 might be left out.
MISSED, NO_TIME = 0.1, 1e-4
#: Least change of a covariance over no time that is a fault, and largest growth that may be a fading memory.
SPREAD, FADING = 0.05, 1.25
#: Least eigenvalue of a covariance from which points can be drawn, in m^2 and (m/s)^2.
DEFINITE = 1e-6


@doctor_check(
    Question("course", "Does the predicted mean move along the tracker's own velocity, and keep it?", misses=True),
    place=85,
    of_filters=True,
    faults={
        "motion_not_along_velocity": KnownFault(
            "the predicted position does not move as the velocity says",
            "Where the predicted position is computed from the velocity, or from speed and course.",
            "px += vx dt and py += vy dt, in m and m/s, with vx = v cos(course) and vy = v sin(course) there and where "
            "the estimate is returned.",
            Role("exact motion", rank=11, drive="tangential_pass"),
        ),
        "velocity_not_kept": KnownFault(
            "the velocity changes without a reason in the motion model",
            "Where the transition is written out, and where the velocity is scaled, limited or smoothed after a step.",
            "Constant velocity leaves vx and vy as they are; a decay has to be exp(-dt / tau).",
            Role("exact motion", rank=11, drive="tangential_pass"),
        ),
    },
)
def course(tracker: TrackerUnderTest) -> PartResult:
    """Predict targets over a tenth of a second, and over an instant after a measurement; compare with the velocity."""
    sensor, velocities, motions, changes = next(iter(tracker.sensors)), list[Array](), list[Array](), list[float]()
    for probe in tracker.probes.general:
        session, estimates = tracker.session_of_most(probe), tracker.predicted(probe, STEP)
        with tracker.recording_failures(probe.name):
            if session is not None and estimates is not None:
                measured, instant_later = _then_missed(session, tracker.scan(probe, sensor, 0.0), INSTANT)
                if measured and instant_later and finite(measured) and np.hypot(*measured.mean[2:]) > STILL:
                    (x, y), (dx, dy) = measured.mean[2:], (instant_later.mean - measured.mean)[2:]
                    changes.append(float(np.hypot(dx, dy) / np.hypot(x, y)))
                    velocities.append(0.5 * (estimates[0].mean + estimates[1].mean)[2:])
                    motions.append((estimates[1].mean - estimates[0].mean)[:2] / STEP)
    if len(motions) < LEAST:
        return PartResult().add("course", None, "there was no moving estimate to predict")
    velocity, motion = np.array(velocities), np.array(motions)
    changed, speed = float(np.median(changes)), np.maximum(np.hypot(*velocity.T), STILL)
    ratio = float(np.median(np.sum(velocity * motion, axis=1) / speed**2))
    across = np.abs(velocity[:, 0] * motion[:, 1] - velocity[:, 1] * motion[:, 0])
    aside = float(np.median(across / (speed * np.maximum(np.hypot(*motion.T), STILL))))
    text = (
        f"over {INSTANT:g} s the velocity changes by {changed:.2g} of it; over {STEP:g} s the estimate moves at "
        f"{ratio:.3g} times its velocity, and {aside:.2g} of its motion is across it (median of {len(motions)})"
    )
    fault, confidence = None, 0.96
    if changed > CHANGED:
        fault = "velocity_not_kept"
    elif aside > ASIDE:
        fault = "motion_not_along_velocity"
        factors = np.linalg.lstsq(velocity, motion, rcond=None)[0]
        if np.abs(velocity @ factors - motion).max() < EXACT * np.abs(motion).max():
            # A sum that fits is as certain as the value of a line.
            confidence = PROVEN
            (xx, xy), (yx, yy) = factors.T
            text += f": in a second px moves by {xx:.2f} vx {xy:+.2f} vy, and py by {yx:.2f} vx {yy:+.2f} vy"
    elif ratio > 0.0 and abs(abs(np.log(ratio)) - np.log(KMH)) < UNIT:
        fault, text = "motion_not_along_velocity", f"{text}: km/h and m/s are confused"
    finding = None if fault is None else Finding(fault, confidence, text, shown_by="tangential_pass")
    return PartResult().add("course", finding is None, text, finding)


@doctor_check(
    Question("no_time", "Does a prediction over no time leave the covariance as it is?", misses=True),
    place=70,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "sigma_points_misdrawn": KnownFault(
            "the sigma points do not have the covariance that they are drawn from",
            "Where the matrix root of the covariance is taken and its vectors are added to the mean.",
            "Points at the mean +- columns (not rows) of the lower Cholesky factor of (n + lambda) P, with the n and "
            "lambda that the weights are made of.",
            Role("exact motion", rank=4, drive="long_run"),
        ),
    },
)
def no_time(tracker: TrackerUnderTest) -> PartResult:
    """Compare the covariances before and after a prediction over no time, which follows a missed scan."""
    if tracker.random or tracker.repeats > 1:
        return PartResult().add("no_time", None, "it draws samples of its own")
    targets = [(probe, name) for probe in tracker.probes.general for name in tracker.sensors]
    pairs = [pair for probe, name in targets for pair in _over_no_time(tracker, probe, name)]
    if len(pairs) < LEAST:
        return PartResult().add("no_time", None, "there was no estimate to predict")
    scaled = [[linalg.symmetrise(scaled_covariances(p, like=pair[0])) for p in pair] for pair in pairs]
    factor = float(np.median([best_multiple(now, was) for was, now in scaled]))
    remainder = float(np.median([np.linalg.norm(now - factor * was) / np.linalg.norm(now) for was, now in scaled]))
    least, most = np.median([np.linalg.eigvalsh(now - was)[[0, -1]] for was, now in scaled], axis=0)
    text = f"over {NO_TIME:g} s the covariance is multiplied by {factor:.3g} (median of {len(pairs)} predictions)"
    words = ""
    if least < -SPREAD and most > SPREAD:
        # Process noise only adds, and a factor changes all entries alike.
        words = _reshaped(tracker, *pairs[0])
    elif not 1.0 - SPREAD < factor < FADING and remainder < 2.0 * SPREAD and not tracker.once(linearises):
        words = f": the points lie {np.sqrt(factor):.3g} times as far from their mean as their weights are made for"
    finding = Finding("sigma_points_misdrawn", 0.96, text + words, shown_by="long_run") if words else None
    return PartResult().add("no_time", finding is None, text, finding)


def _then_missed(session: TrackerSession, scan: Scan, later: float) -> list[Estimate | None]:
    """Return the estimates of a copy of the session at a scan, and at a missed scan ``later`` s after that scan."""
    return session.copy().follow([scan, empty_scan(scan._replace(time=scan.time + later))])


def _over_no_time(tracker: TrackerUnderTest, probe: Probe, name: str) -> Iterator[tuple[Array, Array]]:
    """Yield, once, the covariances before and after a prediction over no time, if valid before the prediction."""
    session = TrackerSession(tracker.make)
    with tracker.recording_failures(probe.name):
        for scan in tracker.approach(probe, (name,)):
            if session.step(scan) is not None:
                missed = empty_scan(scan._replace(time=scan.time + MISSED))
                before, after = _then_missed(session, missed, NO_TIME)
                if before and after and finite(after) and least_eigenvalue(before.covariance) > DEFINITE:
                    yield before.covariance, after.covariance
                return


def _reshaped(tracker: TrackerUnderTest, before: Array, after: Array) -> str:
    """Describe how a prediction over no time changes a covariance; empty text if sigma points cannot be the cause."""
    lower = np.linalg.cholesky(linalg.symmetrise(before))
    if np.linalg.norm(after - lower.T @ lower) < SPREAD * np.linalg.norm(after):
        return ", and becomes L^T L of its lower Cholesky factor L: the points lie along its rows"
    ratios = zip(COMMON_STATE, np.diag(after) / np.diag(before), strict=True)
    values = ", ".join(f"{state} {ratio:.3g}" for state, ratio in ratios)
    return f", its variances by {values}" if tracker.once(linearises) is False else ""
