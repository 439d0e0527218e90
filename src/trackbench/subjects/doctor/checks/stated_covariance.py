"""Is the covariance that is returned computed, whole, in the order of the state, and the one that gains are made of?

A gain is that of the tracker's own predicted covariance, ``K = P H^T (H P H^T + R)^-1``, with the components in the
order of the state. So the order in which a covariance is returned follows from the gains. The columns ``P H^T`` are
``K (I - H K)^-1 R``: the covariance of the whole state with the position follows from a gain alone, and where it is the
same by two sensors, it is the tracker's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from trackbench.base.types import COMMON_STATE, Array
from trackbench.subjects.doctor.checks.drives import harmless
from trackbench.subjects.doctor.expected_gain import linearised_gain, relative_error
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.output_checks import least_eigenvalue
from trackbench.subjects.doctor.samples import has_samples
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial, TrialUpdate

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
#: Difference of the covariances by two sensors, relative to them, up to which they are one: 0.00 with a Kalman filter,
#: sigma points or not, 0.03 with several models.
ONE = 0.08
#: Difference from the returned one, but for a factor, from which on that is another. A factor is also that of a
#: measurement noise.
OTHER = 0.2
#: Least number of targets at which both are known.
LEAST = 3


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
    rule = "it changes, and the gains tell of no zero, no other order and no other covariance"
    return PartResult().add_evidence("stated_covariance", tracker.once(stated_covariance_fault), rule)


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
    if not all(
        np.all(np.abs(estimate.covariance - first) <= UNCHANGED * np.outer(spread, spread)) for estimate in stated
    ):
        return None
    sigmas = ", ".join(f"{value:.3g}" for value in spread)
    text = (
        f"the covariance is the same in all {len(stated)} estimates, after a measurement of any sensor and {LATER:g} s "
        f"without one: standard deviations {sigmas} of px, py (m), vx, vy (m/s)"
    )
    shown_by = tracker.probes.general[0].name
    return Finding("covariance_constant", 0.97, text, shown_by=shown_by)


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
    return Finding("covariance_diagonal", 0.95, text, shown_by=clearest.trial.name)


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
    return Finding("covariance_order", 0.97, text, shown_by=update.trial.name)


def _error(updates: dict[str, list[TrialUpdate]], order: tuple[int, ...] | range) -> float:
    """Of the gains of the sensor that is worst: the median over its trials."""
    return max(float(np.median([_apart(update, order) for update in of])) for of in updates.values())


def _apart(update: TrialUpdate, order: tuple[int, ...] | range) -> float:
    """Of a gain from that of the covariance whose places ``order`` are those of px, py, vx, vy."""
    trial = update.trial
    p: Array = trial.prediction.covariance[np.ix_(order, order)]
    scale = trial.sigma / np.sqrt(np.diag(p))[:, None]
    return relative_error(update.gain, linearised_gain(trial, update.used, p), scale)


class OwnCovariance(NamedTuple):
    """What the gains of two sensors at one target are made of."""

    trial: Trial
    own: Array
    """``(4, 2)`` covariance of the state with the position, the mean by the two sensors."""
    gap: float
    """Between the two, relative to them."""
    apart: float
    """Distance of the nearest multiple of the returned one, relative to the former."""


def another_covariance(tracker: TrackerUnderTest) -> Finding | None:
    """That the gains of all sensors are made of one covariance, and another is returned, if it is so."""
    if has_samples(tracker):
        return None
    targets = _own_covariances(list(tracker.trials.values()))
    if len(targets) < LEAST or np.median([target.gap for target in targets]) > ONE:
        return None
    gap = float(np.median([target.gap for target in targets]))
    apart = float(np.median([target.apart for target in targets]))
    if apart < OTHER or tracker.once(harmless) is not None:
        return None
    clearest = max(targets, key=lambda target: target.apart)
    returned = clearest.trial.prediction.covariance[:, :2]
    sigmas = [float(np.sqrt(max(np.trace(of[:2]), 0.0))) for of in (returned, clearest.own)]
    text = (
        f"the gains of two sensors are made of one covariance (within {gap:.2g}), "
        f"and another is returned: it is off by {apart:.0%} (medians of {len(targets)} targets); for "
        f"{clearest.trial.description} the standard deviation of the position is {sigmas[0]:.3g} m in it, and "
        f"{sigmas[1]:.3g} m by the gains"
    )
    return Finding("wrong_covariance_returned", 0.96, text, shown_by="own_model")


def _own_covariances(of_sensors: Sequence[Sequence[Trial]]) -> list[OwnCovariance]:
    """At each target that two sensors measure after the same scans."""
    columns_of: dict[tuple[str, tuple[str, ...]], list[tuple[Trial, Array]]] = {}
    for trials in of_sensors:
        for trial in trials:
            columns = _by_gain(trial)
            if columns is not None:
                columns_of.setdefault((trial.name, trial.sensor_set), []).append((trial, columns))
    targets = []
    for (trial, first), (_, second), *_ in (pair for pair in columns_of.values() if len(pair) > 1):
        own = 0.5 * (first + second)
        # Position and velocity count alike.
        scale = np.repeat([np.linalg.norm(own[:2]), np.linalg.norm(own[2:])], 2)[:, None] + np.finfo(float).tiny
        returned = trial.prediction.covariance[:, :2] / scale
        factor = float(np.sum(returned * own / scale) / max(np.sum(returned**2), np.finfo(float).tiny))
        targets.append(
            OwnCovariance(
                trial,
                own,
                float(np.linalg.norm((first - second) / scale) / np.linalg.norm(own / scale)),
                float(np.linalg.norm(own / scale - factor * returned) / np.linalg.norm(own / scale)),
            )
        )
    return targets


def _by_gain(trial: Trial) -> Array | None:
    """``(4, 2)``; None where the position is not measured in two components, or no covariance is returned."""
    # Where the returned one is too large, the model may seem curved.
    update = trial.update(trial.predicted_measurement)
    if update is None or not update.used.any() or least_eigenvalue(trial.prediction.covariance) < 0.0:
        return None
    used = update.used
    h, gain = trial.jacobian[used], update.gain[:, used]
    r = trial.scan.noise_covariance[np.ix_(used, used)]
    of_position = ~np.any(h[:, 2:], axis=1)
    if np.sum(of_position) != 2:
        return None
    columns = gain @ np.linalg.pinv(np.eye(len(h)) - h @ gain) @ r
    return np.asarray(columns[:, of_position] @ np.linalg.inv(h[of_position, :2]).T)
