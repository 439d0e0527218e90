"""Are the corrections of the mean and of the covariance those of one gain, the right one for the stated covariance?

With ``K = P H^T (H P H^T + R)^-1`` the mean moves by ``K y`` and the covariance becomes
``(I - K H) P (I - K H)^T + K R K^T`` (Bar-Shalom, Li and Kirubarajan 2001, section 5.2.3). A wrong Jacobian is wrong in
both. Where one of the two is right, the Jacobian is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.subjects.doctor.expected_gain import gain_error, joseph, linearised_gain, relative_error
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.samples import has_samples
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, early_trials
from trackbench.subjects.doctor.trial import Trial, TrialUpdate

#: Distance of a measurement from the predicted one by which both are compared, in its standard deviations.
ASIDE = 2.0
#: Error of a gain that is right, relative to it. Correct filters have 0.003 in the median, with many sigma points 0.04.
RIGHT = 0.05
#: Error of the covariance, relative to its change in the update, that is wrong: correct filters have 0.003 in the
#: median, an IMM 0.02, and a gain that is 1.3 times the applied one 0.09.
WRONG = 0.08
#: How many times as well as its alternative a statement has to fit. Process noise that is added before the update
#: changes the covariance 10 times as much as the gain.
RATIO = 20.0
#: Share of its error by which the covariance of a mixture depends on the innovation: a correct IMM has 0.6 to 2; a
#: filter that converts radar to positions, and their noise with them, 0.06.
OF_MIXTURE = 0.2
#: A factor of the gain that is one, with the covariance of the right gain, and with its own: a larger gain than the
#: optimal one is a tuning, as far as `gain` takes the noise of half the variance for one.
FACTOR, TUNING = 1.1, 1.4
#: By how much the factors of the trials may differ: the gain of a wrong noise has another one at each prediction.
EQUAL = 0.03
#: Error of the gain in the share `MOST` of the trials from which on another one is looked for: correct filters have up
#: to 0.04.
CLEAR, MOST = 0.05, 0.9
#: Least number of trials.
LEAST = 3
#: How often one measurement is applied, at most.
TIMES = 5


class UpdateErrors(NamedTuple):
    """One update held against the right one."""

    update: TrialUpdate
    right: Array
    """``(4, m)`` the right gain of the stated covariance."""
    right_covariance: Array
    """``(4, 4)`` after an update with it."""
    gain: float
    """Error of the applied gain, relative to the right one."""
    factor: float
    """The multiple of the right gain that is nearest to the applied one."""
    beside: float
    """Error of that multiple."""
    of_right: float
    """Error of the covariance, held against that of the right gain, relative to the change in the update."""
    of_applied: float
    """The same, held against that of the applied gain."""


@doctor_check(
    Question(
        "one_gain",
        "Do the mean and the covariance change by one gain?",
        "Do the mean and the covariance change by one gain with {sensor}?",
        each_sensor=True,
        misses=True,
    ),
    place=140,
    of_filters=True,
    of_own_covariance=True,
    faults={
        "gain_inconsistent": KnownFault(
            "the gain is not that of the tracker's own covariance and the stated models",
            "Where the gain is computed and applied to the mean, and where its covariances are summed over sigma "
            "points or samples.",
            "K = P H^T S^-1 (P_xz S^-1 with the same points, weights and means in both sums), S with R once; move the "
            "mean by K y once.",
            Role(rank=40, drive="tangential_pass"),
        ),
        "covariance_update_wrong": KnownFault(
            "the updated covariance is not that of the applied gain",
            "Where the covariance is updated after a measurement.",
            "P = (I - K H) P, or (I - K H) P (I - K H)^T + K R K^T, once for each measurement, with the gain that "
            "moves the mean.",
            Role(rank=28, drive="own_model"),
        ),
    },
)
def one_gain(tracker: TrackerUnderTest) -> PartResult:
    """Hold the updates of the mean and of the covariance against those of the right gain."""
    result = PartResult()
    for name, trials in tracker.trials.items():
        fault = tracker.once(update_faults).get(name)
        if fault is None and not trials:
            result.add(f"one_gain.{name}", None, "there was no estimate to update")
        else:
            rule = "where one of the two is that of the right gain, the other is too"
            result.add_evidence(f"one_gain.{name}", fault, rule)
    return result


def update_faults(tracker: TrackerUnderTest) -> dict[str, Finding]:
    """By sensor."""
    errors = {
        name: _known(trials) if len(_known(trials)) >= LEAST else _known(early_trials(tracker, name))
        for name, trials in tracker.trials.items()
    }
    found = {
        name: fault
        for name, of in errors.items()
        if len(of) >= LEAST and (fault := _of_mean(name, of) or _of_covariance(name, of)) is not None
    }
    # Samples move both, each by itself.
    return {} if found and has_samples(tracker) else found


def _known(trials: Sequence[Trial]) -> list[UpdateErrors]:
    return [errors for trial in trials if (errors := _errors(trial)) is not None]


def _errors(trial: Trial) -> UpdateErrors | None:
    update = trial.linear_update()
    if update is None:
        return None
    gain, right = gain_error(trial, update.gain, update.used)
    scale = trial.gain_scale
    factor = float(np.sum(update.gain * right * scale**2) / np.sum((right * scale) ** 2))
    beside = relative_error(update.gain, factor * right, scale) if factor > 0.0 else np.inf
    after = joseph(trial, right)
    of_right, of_applied = (_covariance_error(update, p, after) for p in (after, joseph(trial, update.gain)))
    return UpdateErrors(update, right, after, gain, factor, beside, of_right, of_applied)


def _covariance_error(update: TrialUpdate, expected: Array, right: Array) -> float:
    spread = update.trial.variance_scale
    change = np.linalg.norm((update.trial.prediction.covariance - right) / spread)
    return float(np.linalg.norm((update.estimate.covariance - expected) / spread) / change)


def _by_innovation(errors: UpdateErrors) -> float:
    """By how much the covariance after a measurement depends on its innovation, relative to its right change."""
    trial = errors.update.trial
    beside = trial.posterior(trial.predicted_measurement + ASIDE * trial.sigma)
    if beside is None:
        return 0.0
    moved = beside.covariance - errors.update.estimate.covariance
    right = trial.prediction.covariance - errors.right_covariance
    return float(np.linalg.norm(moved / trial.variance_scale) / np.linalg.norm(right / trial.variance_scale))


def _of_mean(sensor: str, errors: Sequence[UpdateErrors]) -> Finding | None:
    """The mean is moved by a multiple of the right gain, several times, or by a simpler gain."""
    found = _multiple(errors) or _simpler(errors)
    if found is None:
        return None
    words, factor = found
    worst = max(errors, key=lambda one: one.gain)
    trial = worst.update.trial
    text = f"the gain of {sensor} is {words} ({len(errors)} trials)"
    of_right, of_applied = _covariance_errors(errors)
    if of_right < min(WRONG, of_applied / RATIO):
        text += ", while the covariance after it is that of one update with the right gain"
    elif of_applied < WRONG:
        text += ", and the covariance after it is that of this gain"
    return Finding("gain_inconsistent", 0.95, text, sensor=sensor, factor=factor, shown_by=trial.name)


def _covariance_errors(errors: Sequence[UpdateErrors]) -> tuple[float, float]:
    """Held against the covariance of the right gain and of the applied one: medians over the trials."""
    return float(np.median([one.of_right for one in errors])), float(np.median([one.of_applied for one in errors]))


def _multiple(errors: Sequence[UpdateErrors]) -> tuple[str, float] | None:
    """One multiple in all components and trials, and that."""
    factors = np.array([one.factor for one in errors])
    factor = float(np.median(factors))
    if np.ptp(factors) > EQUAL * factor or max(one.beside for one in errors) > RIGHT:
        return None
    of_right, of_applied = _covariance_errors(errors)
    allowed = FACTOR if of_right < min(WRONG, of_applied / RATIO) else TUNING
    if abs(np.log(max(factor, 1e-9))) < np.log(allowed):
        return None
    words = (
        f"{factor:.4g} times that of its own predicted covariance, the geometry and the stated noise, in all components"
    )
    return words, factor


def _simpler(errors: Sequence[UpdateErrors]) -> tuple[str, float | None] | None:
    """A gain that fits far better than the right one, and how often the measurement is applied, if it is that."""
    ways: list[tuple[str, float | None, Callable[[UpdateErrors], Array]]] = [
        ("that of the diagonal of the innovation covariance alone", None, _of_diagonal)
    ]
    if not _optimal(errors):
        ways.append(("that of the covariance after the update, not before it", None, _of_updated))
        ways += [
            (f"that of {times} updates with the same measurement", float(times), partial(_repeated, times=times))
            for times in range(2, TIMES + 1)
        ]
    misfits = [
        float(np.quantile([relative_error(e.update.gain, way(e), e.update.trial.gain_scale) for e in errors], MOST))
        for _, _, way in ways
    ]
    best, alone = int(np.argmin(misfits)), float(np.quantile([one.gain for one in errors], MOST))
    if misfits[best] > min(RIGHT, alone / RATIO) or alone < CLEAR:
        return None
    words, factor, _ = ways[best]
    return f"{words} (within {misfits[best]:.2g} of it, and within {alone:.2g} of the right one)", factor


def _optimal(errors: Sequence[UpdateErrors]) -> bool:
    """Whether the covariances are ``(I - K H) P`` of the applied gains: these are then the best ones for some noise."""
    misfits = []
    for one in errors:
        p = linalg.symmetrise(one.update.trial.prediction.covariance)
        left = p - one.update.gain @ one.update.trial.jacobian @ p
        misfits.append(_covariance_error(one.update, left, one.right_covariance))
    return float(np.median(misfits)) < WRONG


def _repeated(one: UpdateErrors, times: int) -> Array:
    """The gain of so many updates of the mean, each with the gain of the first."""
    kept = np.eye(4) - one.right @ one.update.trial.jacobian
    return np.asarray(sum(np.linalg.matrix_power(kept, k) @ one.right for k in range(times)))


def _of_updated(one: UpdateErrors) -> Array:
    return linearised_gain(one.update.trial, one.update.used, one.right_covariance)


def _of_diagonal(one: UpdateErrors) -> Array:
    trial = one.update.trial
    cross = linalg.symmetrise(trial.prediction.covariance) @ trial.jacobian.T
    innovation = trial.jacobian @ cross + trial.scan.noise_covariance
    return np.asarray(np.where(one.update.used, cross / np.diag(innovation), 0.0))


def _of_covariance(sensor: str, errors: Sequence[UpdateErrors]) -> Finding | None:
    """The mean is moved by the right gain, and the covariance is not that of it."""
    gain, (off, _) = float(np.median([one.gain for one in errors])), _covariance_errors(errors)
    if gain > RIGHT or off < max(WRONG, RATIO * gain):
        return None
    # By several models a measurement moves their probabilities, and with them the covariance.
    if float(np.median([_by_innovation(one) for one in errors])) > OF_MIXTURE * off:
        return None
    # A fading memory may multiply the covariance after the update, and one that is not reduced has a name of its own.
    if min(float(np.median([_best_multiple(one, p) for one in errors])) for p in (False, True)) < off / RATIO:
        return None
    worst = max(errors, key=lambda one: one.of_right)
    text = (
        f"measurements of {sensor} move the mean by the right gain of the predicted covariance (within {gain:.1g}), "
        f"and the covariance after them is off by {off:.0%} of its right change (medians of {len(errors)} trials)"
    )
    trial = worst.update.trial
    return Finding("covariance_update_wrong", 0.95, text, sensor=sensor, shown_by=trial.name)


def _best_multiple(one: UpdateErrors, of_predicted: bool) -> float:
    """Error of the multiple of the right covariance, or of the predicted one, that is nearest to the stated one."""
    trial = one.update.trial
    spread, stated = trial.variance_scale, one.update.estimate.covariance
    base = (trial.prediction.covariance if of_predicted else one.right_covariance) / spread
    factor = float(np.sum(stated / spread * base) / np.sum(base**2))
    return _covariance_error(one.update, factor * base * spread, one.right_covariance)
