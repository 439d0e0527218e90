"""Does a measurement reduce the covariance that the tracker predicted?

With the gain ``K`` and the Jacobian ``H`` the updated covariance is ``(I - K H) P`` of the predicted one (Bar-Shalom,
Li and Kirubarajan 2001, section 5.2.3). So the covariance that the update started from follows from the other two.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.exhibits import Covariances, StatedBelief
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.right_answers import named, reduction_shown
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial, TrialUpdate

#: Change of the covariance that is none but rounding, relative to its variances.
SAME = 1e-6
#: Share of the state that a measurement replaces, the trace of ``K H``, from which on it has to reduce the covariance.
CLEAR_GAIN = 0.02
#: Time over which the covariance of a filter grows without a measurement, s.
GROWN = 0.5
#: Share of a step's process noise that the update adds: 1 where it is added again, 0 in a correct filter. Sigma points
#: and the mixing of an IMM reach 0.2.
TWICE = (0.6, 1.4)


def covariance_update(tracker: TrackerUnderTest) -> PartResult:
    """Compare the covariances before and after a measurement, at the regular probes."""
    result = PartResult()
    for name, trials in tracker.trials.items():
        updates = [update for trial in trials if (update := _clear(trial)) is not None]
        if len(updates) < 3 or not any(_grows(tracker, update.trial) for update in updates):
            text = "no measurement moves the estimate" if len(updates) < 3 else "its covariance does not grow with time"
            result.add(f"covariance_update.{name}", None, text)
            continue
        finding = _kept(name, updates) or _noise_again(tracker, name, updates)
        ratios = [_position_sigma(update) / _predicted_sigma(update) for update in updates]
        text = (
            f"the standard deviation of the position after a measurement is {min(ratios):.3g} to {max(ratios):.3g} of "
            f"the one before ({len(updates)} trials)"
        )
        result.add(f"covariance_update.{name}", finding is None, text, finding)
    return result


def _clear(trial: Trial) -> TrialUpdate | None:
    update = trial.update(trial.predicted_measurement)
    return update if update is not None and _replaced(update) > CLEAR_GAIN else None


def _replaced(update: TrialUpdate) -> float:
    return float(np.trace(update.gain @ update.trial.jacobian))


def _grows(tracker: TrackerUnderTest, trial: Trial) -> bool:
    later = tracker.peek(trial.session, empty_scan(trial.scan._replace(time=trial.scan.time + GROWN)), trial.name)
    before = float(np.trace(trial.prediction.covariance[:2, :2]))
    return later is not None and float(np.trace(later.covariance[:2, :2])) > (1.0 + SAME) * before


def _kept(name: str, updates: Sequence[TrialUpdate]) -> Finding | None:
    """Of most updates the covariance is the predicted one."""
    kept = [update for update in updates if _change(update) < SAME]
    if len(kept) < 0.8 * len(updates):
        return None
    clearest = max(kept, key=_replaced)
    text = (
        f"a measurement of {name} moves the estimate of {clearest.trial.description}, and its covariance stays as it "
        f"was predicted: the standard deviation of the position is {_predicted_sigma(clearest):.3g} m before and "
        f"{_position_sigma(clearest):.3g} m after ({len(kept)} of {len(updates)} trials)"
    )
    exhibit = reduction_shown(clearest.trial, clearest.estimate)
    return Finding("covariance_not_reduced", 0.97, text, sensor=name, shown_by="own_model", exhibit=exhibit)


def _change(update: TrialUpdate) -> float:
    """Of the position's covariance; that of the velocity depends on the mean where the state has a course."""
    spread = update.trial.state_sigma[:2]
    change = (update.estimate.covariance - update.trial.prediction.covariance)[:2, :2]
    return float(np.abs(change / np.outer(spread, spread)).max())


def _noise_again(tracker: TrackerUnderTest, name: str, updates: Sequence[TrialUpdate]) -> Finding | None:
    """The update starts from a covariance that is larger than the predicted one by a step's process noise."""
    found = [(share, update) for update in updates if (share := _noise_share(tracker, update)) is not None]
    if len(found) < 3:
        return None
    shares = np.array([share for share, _ in found])
    middle = float(np.median(shares))
    if not TWICE[0] < middle < TWICE[1] or np.mean((shares > TWICE[0]) & (shares < TWICE[1])) < 0.7:
        return None
    text = (
        f"the gain and the covariance after a measurement of {name} follow from a predicted covariance with "
        f"{1 + middle:.3g} times the process noise of that which the tracker states at a missed scan (median of "
        f"{len(shares)} trials)"
    )
    typical = min(found, key=lambda one: abs(one[0] - middle))[1]
    exhibit = Covariances(
        f"Covariance that the update of {name} starts from",
        named("right: predicted, as stated at a missed scan", typical.trial.prediction),
        StatedBelief(
            "tracker: that of which the update follows", typical.trial.prediction.mean, _started_from(typical)
        ),
    )
    return Finding("process_noise_twice", 0.9, text, factor=1 + middle, shown_by="own_model", exhibit=exhibit)


def _noise_share(tracker: TrackerUnderTest, update: TrialUpdate) -> float | None:
    """What the update adds to the variance of the speed, over what the last step added.

    A turning model's uncertain course adds to the rest of the velocity, and nothing to first order to the speed.
    """
    trial = update.trial
    if not trial.nearly_linear:
        return None
    last = tracker.peek(trial.session, empty_scan(trial.scan._replace(time=trial.session.given[-1].time)), trial.name)
    if last is None:
        return None
    added = _of_speed(trial, _started_from(update) - trial.prediction.covariance)
    step = _of_speed(trial, trial.prediction.covariance - last.covariance)
    return added / step if step > SAME * _of_speed(trial, last.covariance) else None


def _of_speed(trial: Trial, covariance: Array) -> float:
    """The part of a ``(4, 4)`` covariance along the predicted velocity, m^2/s^2."""
    velocity = trial.prediction.mean[2:]
    along = velocity / max(float(np.hypot(*velocity)), 1e-9)
    return float(along @ covariance[2:, 2:] @ along)


def _started_from(update: TrialUpdate) -> Array:
    """``(4, 4)`` the covariance of which the gain and the updated one follow."""
    remaining = np.eye(4) - update.gain[:, update.used] @ update.trial.jacobian[update.used]
    return np.asarray(np.linalg.pinv(remaining) @ update.estimate.covariance)


def _position_sigma(update: TrialUpdate) -> float:
    return float(np.sqrt(np.trace(update.estimate.covariance[:2, :2])))


def _predicted_sigma(update: TrialUpdate) -> float:
    return float(np.sqrt(np.trace(update.trial.prediction.covariance[:2, :2])))


COVARIANCE_UPDATE_CHECK = DoctorCheck(
    covariance_update,
    place=160,
    questions=(
        Question(
            "covariance_update",
            "Does a measurement reduce the predicted covariance?",
            "Does a measurement of {sensor} reduce the predicted covariance?",
            each_sensor=True,
            misses=True,
        ),
    ),
    of_filters=True,
    of_own_covariance=True,
    faults={
        "covariance_not_reduced": KnownFault(
            "measurements do not reduce the covariance",
            "Where the covariance is updated after a measurement, and where it is stored.",
            "P = (I - K H) P, or Joseph's form, in every update, and store it; a copy that is changed is not the "
            "state's.",
            Role(
                "step",
                rank=16,
                causes="stepped",
                always="wrong_dt process_noise_omitted q_too_small q_too_large q_constant_per_step q_wrong_power_of_dt",
                drive="own_model",
            ),
        ),
        "process_noise_twice": KnownFault(
            "the process noise is added twice",
            "Where Q is added in the prediction, and again before the update.",
            "Add Q once, in the prediction; sigma points that have the noise in an augmented state need none besides.",
            Role(
                "gain growth",
                rank=38,
                causes="gain_inconsistent covariance_update_wrong",
                always="q_too_large",
                drive="own_model",
            ),
        ),
    },
)
