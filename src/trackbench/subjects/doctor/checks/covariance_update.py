"""Does a measurement reduce the predicted covariance, and does the next prediction start from what was returned?

With the gain ``K`` and the Jacobian ``H`` the updated covariance is ``(I - K H) P`` of the predicted one (Bar-Shalom,
Li and Kirubarajan 2001, section 5.2.3). So the covariance that the update started from follows from the other two.

A moment after a measurement a filter states what it returned at it, but for the process noise of a moment. What is the
same with the measurement as at a missed one was not changed by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.session import finite, position_sigma
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest, after_gap, linearises
from trackbench.subjects.doctor.trial import Trial, TrialUpdate

#: Ratio of the position's standard deviations after and before a measurement above which it has grown: no gain of a
#: filter does that.
LARGER = 1.2
#: Change of the covariance that is none but rounding, relative to its variances.
SAME = 1e-6
#: Share of the state that a measurement replaces, the trace of ``K H``, from which on it has to reduce the covariance.
CLEAR_GAIN = 0.02
#: Time over which the covariance of a filter grows without a measurement, s.
GROWN = 0.5
#: Share of a step's process noise that the update adds: 1 where it is added again, 0 in a correct filter. Sigma points
#: and the mixing of an IMM reach 0.2.
TWICE = (0.6, 1.4)


@doctor_check(
    Question(
        "covariance_update",
        "Does a measurement reduce the predicted covariance?",
        "Does a measurement of {sensor} reduce the predicted covariance?",
        each_sensor=True,
        misses=True,
    ),
    place=160,
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
def covariance_update(tracker: TrackerUnderTest) -> PartResult:
    """Compare the covariances before and after a measurement, at the regular probes."""
    result = PartResult()
    for name, trials in tracker.trials.items():
        updates = [update for trial in trials if (update := _clear(trial)) is not None]
        if len(updates) < 3 or not any(_grows(tracker, update.trial) for update in updates):
            text = "no measurement moves the estimate" if len(updates) < 3 else "its covariance does not grow with time"
            result.add(f"covariance_update.{name}", None, text)
            continue
        finding = _kept(name, updates) or _noise_again(tracker, name, updates) or _larger(name, updates)
        ratios = [after / before for before, after in map(_position_sigmas, updates)]
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


def _position_sigmas(update: TrialUpdate) -> tuple[float, float]:
    """Before and after it, m."""
    return position_sigma(update.trial.prediction), position_sigma(update.estimate)


def _grows(tracker: TrackerUnderTest, trial: Trial) -> bool:
    later = tracker.peek(trial.session, empty_scan(trial.scan._replace(time=trial.scan.time + GROWN)), trial.name)
    before = float(np.trace(trial.prediction.covariance[:2, :2]))
    return later is not None and float(np.trace(later.covariance[:2, :2])) > (1.0 + SAME) * before


def _larger(name: str, updates: Sequence[TrialUpdate]) -> Finding | None:
    """Of some updates by a measurement as it was predicted the position is less certain than before."""
    larger = [(*_position_sigmas(update), update) for update in updates]
    larger = [(before, after, update) for before, after, update in larger if after > LARGER * before]
    if len(larger) < 3:
        return None
    before, after, clearest = max(larger, key=lambda entry: entry[1] / entry[0])
    text = (
        f"a measurement of {name} of {clearest.trial.description} makes the covariance larger: the standard deviation "
        f"of the position is {before:.3g} m before and {after:.3g} m after ({len(larger)} of {len(updates)} trials)"
    )
    shown_by = clearest.trial.name
    return Finding("covariance_update_wrong", 0.92, text, sensor=name, shown_by=shown_by)


def _kept(name: str, updates: Sequence[TrialUpdate]) -> Finding | None:
    """Of most updates the covariance is the predicted one."""
    kept = [update for update in updates if _change(update) < SAME]
    if len(kept) < 0.8 * len(updates):
        return None
    clearest = max(kept, key=_replaced)
    before, after = _position_sigmas(clearest)
    text = (
        f"a measurement of {name} moves the estimate of {clearest.trial.description}, and its covariance stays as it "
        f"was predicted: the standard deviation of the position is {before:.3g} m before and {after:.3g} m after "
        f"({len(kept)} of {len(updates)} trials)"
    )
    return Finding("covariance_not_reduced", 0.97, text, sensor=name, shown_by="own_model")


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
    return Finding("process_noise_twice", 0.9, text, factor=1 + middle, shown_by="own_model")


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


#: Time without a measurement before the one that is tried, after which it clearly reduces the covariance, s.
GAP = 1.0
#: Time after it, s.
MOMENT = 1e-3
#: Distance of the tried measurement from the predicted one, in standard deviations.
OFFSET = 2.0
#: Change by a measurement that is clear: of the mean in standard deviations, of the covariance in predicted variances.
CLEAR = 0.1
#: Share of that change which is left a moment later; below it, it is lost. A correct filter has 1.
LEFT = 0.5
#: The same from which on it has grown: by the process noise of a moment it does not.
TOO_LARGE = 2.0
#: Share of the trials in which it is lost, and least number of them.
MOST, LEAST = 0.7, 3


class KeptChange(NamedTuple):
    """A measurement, and what is left of its change a moment later."""

    trial: Trial
    updated: Estimate
    later: Estimate
    mean: float
    """Share of the change of the mean that is left; NaN where the measurement makes no clear one."""
    covariance: float
    """The same of the covariance."""


@doctor_check(
    Question(
        "continuity",
        "Does the next prediction start from the estimate that was returned?",
        "Does the prediction after a measurement of {sensor} start from the estimate that was returned?",
        each_sensor=True,
        misses=True,
    ),
    place=45,
    of_filters=True,
    asks_at_misses=True,
    faults={
        "update_not_kept": KnownFault(
            "the next prediction does not start from the returned estimate",
            "Where the updated mean and covariance are stored.",
            "Store what is returned: a local x or P, or a copy that is changed, is not the tracker's.",
            Role(
                "step",
                rank=14,
                causes="stepped",
                always="wrong_dt process_noise_omitted q_too_small q_too_large q_constant_per_step q_wrong_power_of_dt",
                drive="own_model",
            ),
        )
    },
)
def continuity(tracker: TrackerUnderTest) -> PartResult:
    """Compare the prediction a moment after a measurement with that a moment after a missed one."""
    result, findings = PartResult(), list[Finding]()
    for name in tracker.sensors:
        kept = [one for probe in tracker.probes.general if (one := _kept_change(tracker, probe, name)) is not None]
        finding = _lost(name, kept, "mean") or _lost(name, kept, "covariance") or _jumps(tracker, name, kept)
        shares = [float(np.median(known)) for of in ("mean", "covariance") if len(known := _known(kept, of)) >= LEAST]
        if not shares:
            result.add(f"continuity.{name}", None, "too few measurements change the estimate clearly")
            continue
        left = " and ".join(f"{share:.0%}" for share in shares)
        text = f"{MOMENT:g} s after a measurement {left} of its change of the estimate is left (medians)"
        result.add(f"continuity.{name}", finding is None, text)
        findings += [finding] if finding else []
    # What is lost after every sensor's measurements is stored in one place.
    everywhere = len(findings) == len(tracker.sensors)
    result.findings += [replace(findings[0], sensor=None)] if everywhere else findings
    return result


def _kept_change(tracker: TrackerUnderTest, probe: Probe, name: str) -> KeptChange | None:
    """A measurement off the predicted one, some time after the last."""
    session = tracker.session_of_most(probe)
    trial = None if session is None else after_gap(tracker, probe, name, session, GAP)
    if session is None or trial is None or not trial.usable:
        return None
    measured = trial.scan._replace(measurement=trial.predicted_measurement + OFFSET * trial.sigma)
    with tracker.recording_failures(probe.name):
        updated, later = session.step_and_predict(measured, MOMENT)
        missed, without = session.step_and_predict(empty_scan(measured), MOMENT)
        if updated and later and missed and without and all(map(finite, (updated, later, missed, without))):
            sigma = np.sqrt(np.maximum(np.diag(updated.covariance), np.finfo(float).tiny))
            mean = _share(updated.mean - missed.mean, later.mean - without.mean, sigma)
            covariances = updated.covariance - missed.covariance, later.covariance - without.covariance
            return KeptChange(trial, updated, later, mean, _share(*covariances, trial.variance_scale))
    return None


def _share(change: Array, left: Array, scale: Array) -> float:
    """How much of a change is left: its projection, with both in standard deviations; NaN without a clear change."""
    change, left = change / scale, left / scale
    return float(np.sum(left * change) / np.sum(change**2)) if np.abs(change).max() > CLEAR else np.nan


def _known(kept: list[KeptChange], part: str) -> Array:
    """The shares of the trials with a clear change."""
    return np.array([share for one in kept if np.isfinite(share := getattr(one, part))])


def _lost(name: str, kept: list[KeptChange], part: str) -> Finding | None:
    shares = _known(kept, part)
    if len(shares) < LEAST or np.mean(np.abs(shares) < LEFT) < MOST:
        return None
    one = min(kept, key=lambda one: np.inf if np.isnan(share := getattr(one, part)) else share)
    before, after = map(position_sigma, (one.updated, one.later))
    moved = np.hypot(*(one.later.mean - one.updated.mean)[:2])
    text = (
        f"{MOMENT:g} s after a measurement of {name} {np.median(shares):.0%} of its change of the {part} is left "
        f"(median of {len(shares)} trials, 100 % is right): the position moves by {moved:.2g} m in that time, and its "
        f"standard deviation goes from {before:.3g} to {after:.3g} m ({one.trial.description})"
    )
    return Finding("update_not_kept", 0.95, text, sensor=name, shown_by="own_model")


def _jumps(tracker: TrackerUnderTest, name: str, kept: list[KeptChange]) -> Finding | None:
    """That a change of the covariance is many times as large a moment later.

    A noise that is added is the same with the measurement and without it, so it is the transition by which it grows:
    of no time that is the identity.
    """
    shares = _known(kept, "covariance")
    if len(shares) < LEAST or np.mean(np.abs(shares) > TOO_LARGE) < MOST:
        return None
    text = (
        f"{MOMENT:g} s after a measurement of {name} its change of the covariance is {np.median(np.abs(shares)):.3g} "
        f"times as large (median of {len(shares)} trials, 1 is right): the transition over no time is not the identity"
    )
    fault = "predicted_covariance_wrong" if tracker.once(linearises) is False else "jacobian_wrong"
    return Finding(fault, 0.92, text, shown_by="manoeuvre")
