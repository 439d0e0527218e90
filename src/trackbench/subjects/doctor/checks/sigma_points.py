"""Do the sums over sigma points give back what the points are drawn from?

A prediction over almost no time leaves mean and covariance as they are, whatever the models. A filter whose weights do
not sum to one scales the mean; one whose points lie too near or too far for their weights scales the covariance; one
whose points are no root of the covariance changes its shape.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.checks.drives import harmless
from trackbench.subjects.doctor.expected_gain import gain_error, linearised_gain
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe, probe_rate
from trackbench.subjects.doctor.samples import sampling_noise
from trackbench.subjects.doctor.session import TrackerSession, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, after_gap, linearises
from trackbench.subjects.doctor.trial import Trial

#: A fast target, whose course is known from two measurements: a model with a course is nearly linear.
FAST = (
    Probe("fast_left", "a fast target to the left", (35.0, 24.0, -26.0, 17.0)),
    Probe("fast_behind", "a fast target behind", (-30.0, 28.0, 10.0, 30.0)),
)
#: The time of the prediction, s: 0 might be left out.
NO_TIME = 1e-4
#: Scans within which a track of it is looked at, and how many estimates are.
SCANS, ENOUGH = 12, 4
#: Standard deviation of the velocity over the speed below which it is.
KNOWN = 0.35
#: Variance of the position over that of the motion in no time, at least.
SETTLED = 100.0
#: Change that is a fault: of the mean, relative to it, and of the covariance.
MEAN, COVARIANCE = 0.01, 0.05
#: Least eigenvalue of a covariance that is positive definite, scaled to unit variances.
DEFINITE = 1e-6
#: Growth up to which it may be a memory that fades on purpose.
FADING = 1.25
#: The same diagonal entry of H K where the noise is left out, and where it is not, at the most.
ALL, PART = 0.97, 0.9
#: Relative error of the gain that is none, and one that is.
SMALL, LARGE = 0.05, 0.12
#: Gaps after the last measurement, s.
AT_ONCE, LATER = 1e-3, 0.5


class Unmoved(NamedTuple):
    """What a prediction over no time does to an estimate."""

    mean: float
    """The position's factor."""
    mean_apart: float
    """The rest of the change, relative to the position."""
    covariance: float
    """The covariance's factor."""
    covariance_apart: float
    """The rest of its change, relative to it."""
    least: float
    most: float
    """Extreme eigenvalues of the change of the covariance, scaled to unit variances."""
    before: Estimate
    after: Estimate
    probe: Probe

    @property
    def still(self) -> bool:
        """Whether the mean is left as it is."""
        return abs(self.mean - 1.0) < MEAN and self.mean_apart < MEAN


@doctor_check(
    Question("no_time", "Does a prediction over no time leave the estimate as it is?", misses=True),
    place=70,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "sigma_weights_wrong": KnownFault(
            "the weights of the sigma points do not sum to one",
            "Where the weights of the mean are computed, and where they are multiplied by the points.",
            "W_0 = lambda / (n + lambda) and 1 / (2 (n + lambda)) for each of the 2n others; beta belongs to the "
            "covariance alone.",
            Role(
                "exact",
                rank=3,
                causes="stepped wrong_dt velocity_unit",
                always="sums arctan_quadrant",
                drive="long_run",
            ),
        ),
        "sigma_spread_wrong": KnownFault(
            "the spread of the sigma points does not fit their weights",
            "Where n + lambda is computed for the points, and for the weights.",
            "Points at the mean +- columns of sqrt((n + lambda) P), with the n, alpha and kappa that the weights are "
            "made of.",
            Role("points", rank=5, causes="stepped wrong_dt", always="sums", drive="long_run"),
        ),
        "sigma_points_misdrawn": KnownFault(
            "the sigma points do not have the covariance that they are drawn from",
            "Where the matrix root of the covariance is taken and its vectors are added to the mean.",
            "Add the columns of the lower Cholesky factor (its rows, if the factor is the upper one), not the rows.",
            Role("points", rank=4, causes="stepped wrong_dt", always="sums", drive="long_run"),
        ),
    },
)
def no_time(tracker: TrackerUnderTest) -> PartResult:
    """Predict over no time, early in a track, and update at once after its first measurements."""
    found: list[Unmoved] = []
    gains: list[tuple[Trial, Array, Array]] = []
    for probe in (fast.placed(tracker.probes.site) for fast in FAST):
        for name in tracker.sensors:
            found += list(_unmoved(tracker, probe, name))
            gains += list(_first_gains(tracker, probe, name))
    if not found:
        return PartResult().add("no_time", None, "there was no moving estimate to predict")
    mean = float(np.median([unmoved.mean for unmoved in found]))
    factor = float(np.median([unmoved.covariance for unmoved in found]))
    text = (
        f"over {NO_TIME:g} s the position is multiplied by {mean:.4g} and the covariance by {factor:.3g} (medians of "
        f"{len(found)} predictions)"
    )
    finding = _weights(found, text) or _shape(tracker, found) or _spread(tracker, found, text)
    # A gain of one at the second measurement is also how filters of fixed gains start.
    omitted = _omitted(gains)
    omitted = None if omitted is None or tracker.once(harmless) is not None else omitted
    return PartResult().add("no_time", finding is None, text, finding, omitted)


def _unmoved(tracker: TrackerUnderTest, probe: Probe, name: str) -> Iterator[Unmoved]:
    sensor, session = tracker.sensors[name], TrackerSession(tracker.make)
    rate, seen = probe_rate(sensor), 0
    with tracker.recording_failures(probe.name):
        for k in range(SCANS):
            scan = probe.scan(name, sensor, k / rate)
            before = session.step(scan)
            after = None if before is None else session.peek(empty_scan(scan._replace(time=scan.time + NO_TIME)))
            if before is None or after is None or not (finite(before) and finite(after) and _known(before)):
                continue
            yield _compared(before, after, probe)
            seen += 1
            if seen == ENOUGH:
                return


def _known(estimate: Estimate) -> bool:
    variances = np.diag(estimate.covariance)
    if not variances.min() > 0.0:
        return False
    # Without noise a position is better known than where it is after no time.
    if variances[:2].min() < SETTLED * NO_TIME**2 * variances[2:].max():
        return False
    spread = np.sqrt(variances)
    # Points cannot have an indefinite covariance.
    if np.linalg.eigvalsh(linalg.symmetrise(estimate.covariance) / np.outer(spread, spread))[0] < DEFINITE:
        return False
    sigma, speed = np.sqrt(np.abs(variances[2:].sum())), np.hypot(*estimate.mean[2:])
    return bool(sigma < KNOWN * speed)


def _compared(before: Estimate, after: Estimate, probe: Probe) -> Unmoved:
    moved, position = after.mean[:2] - NO_TIME * after.mean[2:], before.mean[:2]
    mean = float(moved @ position / (position @ position))
    rest = float(np.linalg.norm(moved - mean * position) / np.linalg.norm(position))
    sigma = np.sqrt(np.diag(before.covariance))
    was, now = (linalg.symmetrise(estimate.covariance) / np.outer(sigma, sigma) for estimate in (before, after))
    values = np.linalg.eigvalsh(now - was)
    factor = float(np.sum(now * was) / np.sum(was * was))
    apart = float(np.linalg.norm(now - factor * was) / np.linalg.norm(now))
    return Unmoved(mean, rest, factor, apart, float(values[0]), float(values[-1]), before, after, probe)


def _weights(found: Sequence[Unmoved], text: str) -> Finding | None:
    factors = np.array([unmoved.mean for unmoved in found])
    if abs(np.median(factors) - 1.0) < MEAN or max(one.mean_apart for one in found) > MEAN:
        return None
    if np.ptp(factors) > MEAN * np.median(factors):
        return None
    factor = float(np.median(factors))
    words = f"{text}: the weights of the mean sum to {factor:.4g}"
    first = found[0]
    return Finding("sigma_weights_wrong", 0.98, words, factor=factor, shown_by=first.probe.name)


def _shape(tracker: TrackerUnderTest, found: Sequence[Unmoved]) -> Finding | None:
    """A variance grows where another shrinks: a process noise only adds, and a factor changes all alike."""
    limit = COVARIANCE + 3.0 * tracker.once(sampling_noise)
    mixed = [one for one in found if one.least < -limit and one.most > limit and one.still]
    if len(mixed) < 0.7 * len(found):
        return None
    one = max(mixed, key=lambda each: min(-each.least, each.most))
    ratio = np.diag(one.after.covariance) / np.diag(one.before.covariance)
    numbers = ", ".join(f"{state} {value:.3g}" for state, value in zip(("px", "py", "vx", "vy"), ratio, strict=True))
    text = f"over {NO_TIME:g} s the variances are multiplied by different factors: {numbers} ({one.probe.description})"
    factor = np.linalg.cholesky(linalg.symmetrise(one.before.covariance))
    swapped = factor.T @ factor
    # The covariance becomes that of points along the rows of the factor of px, py, vx, vy.
    rows = bool(np.linalg.norm(one.after.covariance - swapped) < COVARIANCE * np.linalg.norm(swapped))
    if rows:
        text += "; it becomes L^T L of the lower Cholesky factor L: the points lie along its rows"
    return Finding("sigma_points_misdrawn", 0.96, text, shown_by=one.probe.name)


def _spread(tracker: TrackerUnderTest, found: Sequence[Unmoved], text: str) -> Finding | None:
    factors = np.array([unmoved.covariance for unmoved in found])
    factor = float(np.median(factors))
    error = float(np.std(factors) / np.sqrt(len(factors)))
    if not (factor < 1 - COVARIANCE - 3 * error or factor > FADING + 3 * error) or tracker.once(linearises):
        return None
    if not all(one.still for one in found) or np.median([one.covariance_apart for one in found]) > 2 * COVARIANCE:
        return None
    words = f"{text}: the points lie {np.sqrt(factor):.3g} times as far from their mean as their weights are made for"
    typical = min(found, key=lambda unmoved: abs(unmoved.covariance - factor))
    return Finding("sigma_spread_wrong", 0.95, words, factor=factor, shown_by=typical.probe.name)


def _first_gains(tracker: TrackerUnderTest, probe: Probe, name: str) -> Iterator[tuple[Trial, Array, Array]]:
    """``(m,)`` the diagonal of H K of an update at once after the first estimate, and the right one."""
    sensor, session = tracker.sensors[name], TrackerSession(tracker.make)
    rate = probe_rate(sensor)
    with tracker.recording_failures(probe.name):
        for k in range(SCANS):
            if session.step(probe.scan(name, sensor, k / rate)) is None:
                continue
            scan = probe.scan(name, sensor, k / rate + AT_ONCE)
            prediction = session.peek(empty_scan(scan))
            if prediction is None:
                return
            trial = Trial(probe.name, probe.description, scan, prediction, session)
            update = trial.update(trial.predicted_measurement) if trial.usable else None
            if update is not None:
                h = trial.jacobian
                yield trial, np.diag(h @ update.gain), np.diag(h @ linearised_gain(trial))
            return


def _omitted(gains: Sequence[tuple[Trial, Array, Array]]) -> Finding | None:
    """A position that follows the measurement wholly, where the prediction is as good."""
    clear = [(trial, applied[:2], right[:2]) for trial, applied, right in gains if right[:2].max() < PART]
    off = [one for one in clear if one[1].min() > ALL]
    if not clear or len(off) < len(clear):
        return None
    trial, applied, right = off[0]
    text = (
        f"a measurement of {trial.scan.sensor} moves the predicted one by {applied.min():.4g} of the innovation, "
        f"where {right.min():.3g} to {right.max():.3g} is right with the stated noise: as if there were no noise"
    )
    return Finding("measurement_noise_omitted", 0.97, text, shown_by=trial.name)


def not_redrawn(tracker: TrackerUnderTest, sensor: str) -> Finding | None:
    """That the gain is right at once after a measurement, and without the process noise after a gap, if it is so."""
    errors: dict[float, list[float]] = {AT_ONCE: [], LATER: []}
    for probe in tracker.probes.general:
        for sensor_set in tracker.sensor_sets():
            session = tracker.session_at(probe, sensor_set)
            for gap, found in errors.items():
                trial = None if session is None else after_gap(tracker, probe, sensor, session, gap)
                update = None if trial is None or not trial.usable else trial.linear_update()
                if trial is not None and update is not None:
                    found.append(gain_error(trial, update.gain)[0])
    if min(len(found) for found in errors.values()) < 3:
        return None
    at_once, later = (float(np.median(found)) for found in errors.values())
    if not (at_once < SMALL and later > LARGE):
        return None
    text = (
        f"the gain is that of the predicted covariance at {AT_ONCE:g} s after a measurement (within {at_once:.1%}) "
        f"and off by {later:.0%} at {LATER:g} s: the update goes on with points in which the process noise is missing"
    )
    shown_by = tracker.probes.general[0].name
    return Finding("sigma_points_not_redrawn", 0.95, text, sensor=sensor, shown_by=shown_by)
