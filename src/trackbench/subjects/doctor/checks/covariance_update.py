"""Is the covariance computed, whole and in the order of the state, and does a measurement reduce it?

A gain is that of the tracker's own predicted covariance, ``K = P H^T (H P H^T + R)^-1``, with the components in the
order of the state. So the order in which a covariance is returned follows from the gains. With the gain ``K`` and the
Jacobian ``H`` the updated covariance is ``(I - K H) P`` of the predicted one (Bar-Shalom, Li and Kirubarajan 2001,
section 5.2.3). So the covariance that the update started from follows from the other two.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from trackbench.base.types import COMMON_STATE, Array
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.checks.returned import another_covariance
from trackbench.subjects.doctor.exhibits import Covariances, Panel, StatedBelief, state_matrices
from trackbench.subjects.doctor.expected_gain import linearised_gain, relative_error
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.right_answers import reduction_shown, stated_belief
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial, TrialUpdate

#: Ratio of the position's standard deviations after and before a measurement above which it has grown: no gain of a
#: filter does that.
LARGER = 1.2
#: Change of a covariance that is none but rounding, relative to its variances.
UNCHANGED = 1e-9
#: Prediction after which a covariance has grown, s.
LATER = 1.0
#: Share of the gain by positions that moves the velocity, which a diagonal covariance has none of.
OF_VELOCITY = 0.05
#: Errors of the gain, relative to it: one that is not that of the stated covariance, and one that is. Correct filters
#: have 0.003 in the median, an IMM 0.07.
OFF, NEAR = 0.2, 0.1
#: The second over the first: the gains of a wrong Jacobian are off with every order.
RATIO = 0.2
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
    Question("stated_covariance", "Is the covariance computed, whole, and in the order of the estimate?", misses=True),
    place=40,
    of_filters=True,
    faults={
        "covariance_constant": KnownFault(
            "the covariance never changes",
            "Where the covariance is set and returned.",
            "Compute it: P = F P F^T + Q in each prediction, (I - K H) P (I - K H)^T + K R K^T in each update, with "
            "fixed gains K too.",
            Role("step", rank=34, causes="stepped", drive="long_gap"),
        ),
        "covariance_diagonal": KnownFault(
            "only the diagonal of the covariance is returned",
            "Where the estimate is returned.",
            "Return the whole 4 x 4 covariance, with that of position and velocity.",
            Role("step", rank=35, causes="stepped", drive="manoeuvre"),
        ),
        "covariance_order": KnownFault(
            "the covariance is returned in another order than the estimate",
            "Where the estimate is returned.",
            "Order rows and columns as the mean: px, py, vx, vy, by P[np.ix_(order, order)].",
            Role("step", rank=36, causes="stepped", drive="manoeuvre"),
        ),
        "wrong_covariance_returned": KnownFault(
            "another matrix is returned for the covariance",
            "Where the estimate is returned.",
            "Return the covariance P of the updated state: not Q or S, not a root or an inverse of P, not that before.",
            Role(
                "step",
                rank=14,
                causes="stepped",
                always="covariance_not_psd predicted_covariance_not_psd",
                drive="own_model",
            ),
        ),
    },
)
def stated_covariance(tracker: TrackerUnderTest) -> PartResult:
    """Look whether the covariances change, and whether the gains are made of them, whole and in the order returned."""
    if not any(tracker.trials.values()):
        return PartResult().add("stated_covariance", None, "there was no estimate to update")
    fault = tracker.once(stated_covariance_fault)
    if fault is not None:
        return PartResult().add("stated_covariance", False, fault.evidence, fault)
    text = "it changes, and the gains tell of no zero, no other order and no other covariance"
    return PartResult().add("stated_covariance", True, text)


def stated_covariance_fault(tracker: TrackerUnderTest) -> Finding | None:
    """What is wrong with the covariances that are returned, if the gains are not made of them."""
    if constant := _constant(tracker):
        return constant
    updates = {
        name: [update for trial in trials if (update := trial.linear_update()) is not None]
        for name, trials in tracker.trials.items()
    }
    known = {name: of for name, of in updates.items() if len(of) >= 3}
    return (_diagonal(known) or _ordered(known) or another_covariance(tracker)) if known else None


def _constant(tracker: TrackerUnderTest) -> Finding | None:
    """One covariance after measurements, and without."""
    pairs = [over for probe in tracker.probes.general if (over := tracker.predicted(probe, LATER)) is not None]
    trials = [trial for of in tracker.trials.values() for trial in of]
    updated = [one for trial in trials if (one := trial.posterior(trial.predicted_measurement)) is not None]
    stated = [*(one for pair in pairs for one in pair), *updated]
    if len(pairs) < 3 or len(updated) < 3:
        return None
    first = stated[0].covariance
    spread = np.sqrt(np.abs(np.diag(first)))
    if not all(np.all(np.abs(one.covariance - first) <= UNCHANGED * np.outer(spread, spread)) for one in stated):
        return None
    sigmas = ", ".join(f"{value:.3g}" for value in spread)
    text = (
        f"the covariance is the same in all {len(stated)} estimates, after a measurement of any sensor and {LATER:g} s "
        f"without one: standard deviations {sigmas} of px, py (m), vx, vy (m/s)"
    )
    panels = (Panel("after measurements", first), Panel(f"{LATER:g} s later", pairs[0][1].covariance))
    exhibit = state_matrices("Covariance", panels, tuple((i, i) for i in range(4)))
    shown_by = tracker.probes.general[0].name
    return Finding("covariance_constant", 0.97, text, shown_by=shown_by, exhibit=exhibit)


def _diagonal(updates: dict[str, list[TrialUpdate]]) -> Finding | None:
    """No covariance has an entry beside the diagonal, and positions move the velocity."""
    every = [update for of in updates.values() for update in of]
    if any(
        np.any(one.covariance[~np.eye(4, dtype=bool)]) for up in every for one in (up.estimate, up.trial.prediction)
    ):
        return None
    shares = [(_velocity_share(update), update) for update in every]
    known = [(share, update) for share, update in shares if np.isfinite(share)]
    if not known or np.median([share for share, _ in known]) < OF_VELOCITY:
        return None
    share, clearest = max(known, key=lambda one: one[0])
    text = (
        f"every entry beside the diagonal is zero in the covariances of {len(every)} predictions and updates, while "
        f"measured positions move the velocity too ({share:.0%} of the gain of {clearest.trial.scan.sensor}, in "
        f"standard deviations, for {clearest.trial.description}): that takes the covariance of position and velocity"
    )
    exhibit = state_matrices(
        f"Predicted covariance: {clearest.trial.description}",
        (Panel("returned", clearest.trial.prediction.covariance),),
        ((0, 2), (1, 3), (2, 0), (3, 1)),
    )
    return Finding("covariance_diagonal", 0.95, text, shown_by=clearest.trial.name, exhibit=exhibit)


def _velocity_share(update: TrialUpdate) -> float:
    """Of the gain of those components of the measurement that depend on the position alone; NaN without any."""
    of_position = update.used & ~np.any(update.trial.jacobian[:, 2:], axis=1)
    gain = update.relative_gain[:, of_position]
    return float(np.linalg.norm(gain[2:]) / np.linalg.norm(gain)) if of_position.any() else float("nan")


def _ordered(updates: dict[str, list[TrialUpdate]]) -> Finding | None:
    """The gains are those of the covariances with another order of the components."""
    stated = _error(updates, range(4))
    if stated < OFF:
        return None
    errors = {order: _error(updates, order) for order in permutations(range(4))}
    best = min(errors, key=lambda order: errors[order])
    if errors[best] > min(NEAR, RATIO * stated):
        return None
    names = [""] * 4
    for component, place in enumerate(best):
        names[place] = COMMON_STATE[component]
    text = (
        f"the covariance is returned in the order {', '.join(names)}: so ordered it gives the gains of all sensors "
        f"within {errors[best]:.2g} (relative, median), and as px, py, vx, vy within {stated:.2g}"
    )
    update = max((of[0] for of in updates.values()), key=lambda one: _apart(one, range(4)))
    p = update.trial.prediction.covariance
    right = p[np.ix_(best, best)]
    spread = np.sqrt(np.outer(np.diag(right), np.diag(right)))
    wrong = np.abs(p - right) > UNCHANGED * spread
    panels = (Panel("returned", p), Panel("as px, py, vx, vy", right, "right"))
    marked = tuple((int(i), int(j)) for i, j in np.argwhere(wrong))
    exhibit = state_matrices(f"Predicted covariance: {update.trial.description}", panels, marked)
    return Finding("covariance_order", 0.97, text, shown_by=update.trial.name, exhibit=exhibit)


def _error(updates: dict[str, list[TrialUpdate]], order: tuple[int, ...] | range) -> float:
    """Of the gains of the sensor that is worst: the median over its trials."""
    return max(float(np.median([_apart(update, order) for update in of])) for of in updates.values())


def _apart(update: TrialUpdate, order: tuple[int, ...] | range) -> float:
    """Of a gain from that of the covariance whose places ``order`` are those of px, py, vx, vy."""
    trial = update.trial
    p: Array = trial.prediction.covariance[np.ix_(order, order)]
    scale = trial.sigma / np.sqrt(np.diag(p))[:, None]
    return relative_error(update.gain, linearised_gain(trial, update.used, p), scale)


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


def _larger(name: str, updates: Sequence[TrialUpdate]) -> Finding | None:
    """Of some updates by a measurement as it was predicted the position is less certain than before."""
    larger = [update for update in updates if _position_sigma(update) > LARGER * _predicted_sigma(update)]
    if len(larger) < 3:
        return None
    clearest = max(larger, key=lambda update: _position_sigma(update) / _predicted_sigma(update))
    text = (
        f"a measurement of {name} of {clearest.trial.description} makes the covariance larger: the standard deviation "
        f"of the position is {_predicted_sigma(clearest):.3g} m before and {_position_sigma(clearest):.3g} m after "
        f"({len(larger)} of {len(updates)} trials)"
    )
    exhibit = reduction_shown(clearest.trial, clearest.estimate)
    shown_by = clearest.trial.name
    return Finding("covariance_update_wrong", 0.92, text, sensor=name, shown_by=shown_by, exhibit=exhibit)


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
        stated_belief("right: predicted, as stated at a missed scan", typical.trial.prediction),
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
