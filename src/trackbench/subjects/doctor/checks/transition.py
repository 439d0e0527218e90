"""Does the predicted covariance follow from the one before, and move as the tracker's own prediction moves the mean?

The same prediction of two estimates with one mean adds the same process noise, so that the difference of their
covariances is moved by the transition's Jacobian alone: ``F (P1 - P2) F^T``. A measurement where it is predicted leaves
the mean, and takes ``K S K^T`` from the covariance of a missed one (Bar-Shalom, Li and Kirubarajan 2001, section
5.2.3). ``F K`` is what a change of that measurement does to the predicted mean, hidden states included.

The same scans, with target and sensors moved by a constant, have the same innovations. So the estimates are moved by
it, and their covariances are the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Estimate
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.expected_gain import OUTSIDE
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.matrices import straight
from trackbench.subjects.doctor.output_checks import least_eigenvalue, scaled_covariances
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.samples import OTHER_ANSWERS, has_samples
from trackbench.subjects.doctor.session import finite, position_sigma
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, linearises
from trackbench.subjects.doctor.trial import GAIN_STEP, Trial

#: Targets that turn all the time.
TURNING = (
    Probe("turning_left", "a target ahead that turns to the left", (18.0, 13.0, -4.0, 9.0), turn_rate=0.4),
    Probe("turning_right", "a target ahead that turns to the right", (22.0, -12.0, 5.0, -8.0), turn_rate=-0.4),
)
#: Time of the prediction, s.
STEP = 0.5
#: Difference from what the mean's motion makes of the covariance, relative to it.
WRONG = 0.07
#: Innovation, in standard deviations of the measurement, and the share of the difference from which on the covariance
#: depends on it: by the geometry, and by an adaptive noise or the weights of several models.
ASIDE, LEARNED, ADAPTIVE = 1.5, 0.1, 0.3
#: Gap after which a covariance is larger, s; how much larger, and the difference of two covariances that is rounding.
GAP, GROWN, SAME = 1.0, 1.1, 1e-6
#: Share of the square of its motion by which a position's variance grows, at a short step too, s; how much larger it
#: may be at a long one, and the speed from which on it is clear, m/s. With a white acceleration it is 5 to 25 times as
#: large.
SQUARED, SHORT, FASTER, MOVING = 0.3, 0.1, 2.0, 3.0
#: Share of the trials that has to be known.
MOST = 0.7
#: Least number of trials, and least change of a covariance by a measurement, in its variances.
LEAST, TAKEN = 3, 1e-3


class Moved(NamedTuple):
    """What a prediction makes of the difference of two covariances."""

    error: float
    """Of the stated difference, relative to the difference before, moved as the mean is; in predicted variances."""
    learned: float
    """By how much it depends on the innovation, relative to it."""
    straight: bool
    """Whether the mean moves by its own velocity."""


@doctor_check(
    Question("transition", "Does the covariance of a turning target move as its mean is predicted to?", misses=True),
    place=102,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "predicted_covariance_wrong": KnownFault(
            "the predicted covariance does not follow from the one before",
            "Where the covariance is predicted and stored.",
            "P = F P F^T + Q, or the spread of the moved points about their own mean plus Q, at every scan, missed "
            "ones too.",
            Role(rank=13, drive="long_gap"),
        )
    },
)
def transition(tracker: TrackerUnderTest) -> PartResult:
    """Predict after measured and missed scans of turning targets, and after gaps of several lengths."""
    if (wrong := _forgets(tracker) or _about_another_mean(tracker)) is not None:
        return PartResult().add("transition", False, wrong.evidence, wrong)
    if has_samples(tracker):
        return PartResult().add("transition", None, OTHER_ANSWERS)
    pairs = [
        moved
        for probe in (target.placed(tracker.probes.site) for target in TURNING)
        for name in tracker.sensors
        if (moved := _moved(tracker, probe, name)) is not None
    ]
    if any(pair.learned > ADAPTIVE for pair in pairs):
        return PartResult().add("transition", None, "the covariance depends on the innovations")
    pairs = [pair for pair in pairs if pair.learned < LEARNED]
    if len(pairs) < MOST * len(TURNING) * len(tracker.sensors):
        return PartResult().add("transition", None, "the measurements do not change the covariance by their gain alone")
    errors = [pair.error for pair in pairs]
    text = (
        f"over {STEP:g} s of a turn the difference of two covariances is {np.median(errors):.2g} (relative, median of "
        f"{len(pairs)}) from that which the motion of the mean makes of it"
    )
    if np.median(errors) < WRONG:
        return PartResult().add("transition", True, text)
    if tracker.once(linearises) is False:
        fault, words = "predicted_covariance_wrong", "the spread of the moved sigma points"
    elif all(pair.straight for pair in pairs):
        fault, words = "predicted_covariance_wrong", "the mean moves straight on, and F P F^T of the covariance"
    else:
        fault, words = "jacobian_wrong", "the transition's Jacobian"
    evidence = f"{text}: {words} is not that of the motion that the mean makes"
    finding = Finding(fault, 0.94, evidence, shown_by="manoeuvre")
    return PartResult().add("transition", False, text, finding)


def _moved(tracker: TrackerUnderTest, probe: Probe, name: str) -> Moved | None:
    trial = _just_measured(tracker, probe, name)
    if trial is None or not trial.usable:
        return None
    steps, aside = np.diag(GAIN_STEP * trial.sigma), ASIDE * trial.sigma
    around = [*(trial.predicted_measurement + step for step in (*steps, *-steps, aside, -aside))]
    scans = [empty_scan(trial.scan)]
    scans += [trial.scan._replace(measurement=measurement) for measurement in (trial.predicted_measurement, *around)]
    answers: list[tuple[Estimate, Estimate]] = []
    with tracker.recording_failures(probe.name):
        for scan in scans:
            now, later = trial.session.step_and_predict(scan, STEP)
            if now is None or later is None or not (finite(now) and finite(later)):
                return None
            answers.append((now, later))
    if len(answers) < len(scans):
        return None
    if any(least_eigenvalue(scaled_covariances(later.covariance)) < 0.0 for _, later in answers):
        return None
    (missed, measured), sides, (farther, nearer) = answers[:2], answers[2:-2], answers[-2:]
    count, sigma = len(steps), [np.sqrt(np.maximum(np.diag(estimate.covariance), 1e-12)) for estimate in missed]
    # In standard deviations, before and after the prediction.
    gain, moved_gain = (
        np.stack(
            [ahead[k].mean - behind[k].mean for ahead, behind in zip(sides[:count], sides[count:], strict=True)], 1
        )
        / (2.0 * GAIN_STEP * sigma[k][:, None])
        for k in (0, 1)
    )
    taken, left = ((missed[k].covariance - measured[k].covariance) / np.outer(sigma[k], sigma[k]) for k in (0, 1))
    inverse = np.linalg.pinv(gain, rcond=1e-6)
    innovation = inverse @ linalg.symmetrise(taken) @ inverse.T
    size = float(np.linalg.norm(taken))
    if not size > TAKEN or float(np.linalg.norm(taken - gain @ innovation @ gain.T)) > OUTSIDE * size:
        return None
    scale = np.outer(sigma[1], sigma[1])
    learned = 0.5 * (farther[1].covariance + nearer[1].covariance) - measured[1].covariance
    expected = moved_gain @ innovation @ moved_gain.T
    # A memory may fade on purpose.
    if not np.any(expected):
        # What moves the mean is not kept.
        return None
    expected *= max(1.0, float(np.sum(left * expected) / np.sum(expected**2)))
    error = float(np.linalg.norm(left - expected) / np.linalg.norm(expected))
    share = float(np.linalg.norm(learned / scale) / np.linalg.norm(left))
    off = (missed[1].mean - straight(STEP) @ missed[0].mean) / sigma[1]
    return Moved(error, share, bool(np.abs(off).max() < SAME))


def _just_measured(tracker: TrackerUnderTest, probe: Probe, name: str) -> Trial | None:
    """Return a trial at the time of a measurement that was just used: no belief is kept at an earlier time."""
    before = tracker.trial(probe, name, tracker.sensor_sets()[-1])
    if before is None or not before.usable:
        return None
    with tracker.recording_failures(probe.name):
        session = before.session.copy()
        session.step(before.scan._replace(measurement=before.predicted_measurement))
        prediction = session.predict(before.scan)
        if prediction is not None:
            return Trial(probe.name, probe.description, before.scan, prediction, session)
    return None


def _forgets(tracker: TrackerUnderTest) -> Finding | None:
    """That a prediction makes the same covariance of a small and of a large one, if it does."""
    trials: list[tuple[Probe, Estimate, Estimate, Estimate]] = []
    name = next(iter(tracker.sensors))
    for probe in tracker.probes.general:
        early, gap = tracker.predicted(probe, STEP), tracker.predicted(probe, GAP)
        session = tracker.session_of_most(probe)
        if early is None or gap is None or session is None:
            continue
        with tracker.recording_failures(probe.name):
            twin = session.copy()
            later = [twin.step(tracker.missed(probe, name, time)) for time in (0.0, GAP, GAP + STEP)][-1]
            if later is not None and finite(later):
                trials.append((probe, early[0], gap[1], early[1]))
                if _apart(gap[1], early[0]) < GROWN - 1.0 or _apart(later, early[1]) > SAME:
                    return None
    if len(trials) < LEAST:
        return None
    probe, small, large, after = trials[0]
    sigmas = list(map(position_sigma, (small, large, after)))
    text = (
        f"a prediction over {STEP:g} s makes the same covariance of any before it: the standard deviation of the "
        f"position is {sigmas[0]:.3g} or {sigmas[1]:.3g} m before, {sigmas[2]:.3g} m after it ({len(trials)} trials)"
    )
    return Finding("predicted_covariance_wrong", 0.96, text, shown_by="long_gap")


def _about_another_mean(tracker: TrackerUnderTest) -> Finding | None:
    """That the position's covariance grows by the square of its motion, as about the mean before, if it does.

    That of a process noise grows faster.
    """
    targets = []
    for probe in tracker.probes.general:
        shares = [_squared(*over, step) for step in (SHORT, STEP) if (over := tracker.predicted(probe, step))]
        if len(shares) == 2 and np.isfinite(shares).all():
            targets.append((shares, probe))
    if len(targets) < LEAST:
        return None
    short, long = np.median([shares for shares, _ in targets], axis=0)
    if min(short, long) < SQUARED or long > FASTER * short:
        return None
    probe = targets[0][1]
    text = (
        f"the variance of the position along the motion grows by the square of the motion itself, times {short:.3g} "
        f"over {SHORT:g} s and {long:.3g} over {STEP:g} s (medians of {len(targets)} targets): the spread is that "
        "about the mean before the prediction"
    )
    over = tracker.predicted(probe, STEP)
    return Finding("predicted_covariance_wrong", 0.95, text, shown_by="long_gap")


def _squared(now: Estimate, later: Estimate, step: float) -> float:
    """The growth of the position's variance along its motion over the square of that; NaN where it hardly moves."""
    moved, motion = (later.mean - now.mean)[:2], straight(step)
    length = float(np.hypot(*moved))
    grown = (later.covariance - motion @ now.covariance @ motion.T)[:2, :2]
    return float(moved @ grown @ moved) / length**4 if length > MOVING * step else np.nan


def _apart(one: Estimate, other: Estimate) -> float:
    """The largest difference of two covariances in variances of the latter."""
    sigma = np.sqrt(np.maximum(np.diag(other.covariance), 1e-12))
    return float(np.abs((one.covariance - other.covariance) / np.outer(sigma, sigma)).max())
