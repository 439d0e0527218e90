"""Is the returned covariance computed, and do the tracker's gains follow from it?

A gain is made of the tracker's own predicted covariance: ``K = P H^T (H P H^T + R)^-1``. So the columns ``P H^T`` are
``K (I - H K)^-1 R``, and the covariance of the whole state with the position follows from a gain alone. Where two
sensors give the same covariance, it is the tracker's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.checks.drives import harmless
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.output_checks import least_eigenvalue
from trackbench.subjects.doctor.samples import has_samples
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial

#: Change of a covariance that is only rounding, relative to its variances.
UNCHANGED = 1e-9
#: Time of a prediction in which a covariance grows, s.
LATER = 1.0
#: Largest difference of the covariances by two sensors, relative to them, at which they are one: 0.00 with a Kalman
#: filter, sigma points or not, 0.03 with several models.
ONE = 0.08
#: Least difference, but for a factor, of the gains' covariance from the returned one at which they are two. A factor
#: may also come from a measurement noise.
OTHER = 0.2
#: Least number of targets at which the covariances by two sensors are known.
LEAST = 3


@doctor_check(
    Question("stated_covariance", "Is the returned covariance computed, and the one used for the gains?", misses=True),
    place=40,
    of_filters=True,
    faults={
        "covariance_constant": KnownFault(
            "the covariance never changes",
            "Where the covariance is set and returned.",
            "Compute P: P = F P F^T + Q in each prediction, (I - K H) P (I - K H)^T + K R K^T in each update, with "
            "fixed gains K too.",
            Role(rank=34, drive="long_gap"),
        ),
        "wrong_covariance_returned": KnownFault(
            "another matrix is returned for the covariance",
            "Where the estimate is returned.",
            "Return the covariance P of the updated state: not Q or S, not a root or an inverse of P, not an old P.",
            Role(rank=14, drive="own_model"),
        ),
    },
)
def stated_covariance(tracker: TrackerUnderTest) -> PartResult:
    """Compare returned covariances with each other, and with the covariances that the gains are made of."""
    if not any(tracker.trials.values()):
        return PartResult().add("stated_covariance", None, "there was no estimate to update")
    rule = "it changes, and the gains imply no other covariance"
    return PartResult().add_evidence("stated_covariance", tracker.once(stated_covariance_fault), rule)


def stated_covariance_fault(tracker: TrackerUnderTest) -> Finding | None:
    """Report a returned covariance that never changes, or that the gains are not made of."""
    if constant := _constant(tracker):
        return constant
    return another_covariance(tracker) if any(tracker.trials.values()) else None


def _constant(tracker: TrackerUnderTest) -> Finding | None:
    """Report a covariance that is the same in all estimates, with a measurement and without."""
    pairs = [pair for probe in tracker.probes.general if (pair := tracker.predicted(probe, LATER)) is not None]
    trials = [trial for of_sensor in tracker.trials.values() for trial in of_sensor]
    updated = [after for trial in trials if (after := trial.posterior(trial.predicted_measurement)) is not None]
    stated = [*(estimate for pair in pairs for estimate in pair), *updated]
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


class OwnCovariance(NamedTuple):
    """Covariance that the gains of two sensors at one target imply, compared with the returned covariance."""

    trial: Trial
    own: Array
    """Covariance ``(4, 2)`` of state and position: the mean of the two that the gains of the sensors imply."""
    gap: float
    """Difference between the covariances that the gains of the two sensors imply, relative to ``own``."""
    distance: float
    """Distance of ``own`` from the nearest multiple of the returned covariance, relative to ``own``."""


def another_covariance(tracker: TrackerUnderTest) -> Finding | None:
    """Return a finding if the gains of all sensors follow from one covariance and the tracker returns another."""
    if has_samples(tracker):
        return None
    targets = _own_covariances(list(tracker.trials.values()))
    if len(targets) < LEAST or np.median([target.gap for target in targets]) > ONE:
        return None
    gap = float(np.median([target.gap for target in targets]))
    distance = float(np.median([target.distance for target in targets]))
    if distance < OTHER or tracker.once(harmless) is not None:
        return None
    clearest = max(targets, key=lambda target: target.distance)
    returned = clearest.trial.prediction.covariance[:, :2]
    sigmas = [float(np.sqrt(max(np.trace(p[:2]), 0.0))) for p in (returned, clearest.own)]
    text = (
        f"the gains of two sensors are made of one covariance (within {gap:.2g}), "
        f"and another is returned: it is off by {distance:.0%} (medians of {len(targets)} targets); for "
        f"{clearest.trial.description} the standard deviation of the position is {sigmas[0]:.3g} m in it, and "
        f"{sigmas[1]:.3g} m by the gains"
    )
    return Finding("wrong_covariance_returned", 0.96, text, shown_by="own_model")


def _own_covariances(of_sensors: Sequence[Sequence[Trial]]) -> list[OwnCovariance]:
    """Return the covariance that gains are made of at each target that two sensors measure after the same scans."""
    columns_of: dict[tuple[str, tuple[str, ...]], list[tuple[Trial, Array]]] = {}
    for trials in of_sensors:
        for trial in trials:
            columns = _columns_by_gain(trial)
            if columns is not None:
                columns_of.setdefault((trial.name, trial.sensor_set), []).append((trial, columns))
    targets = []
    for (trial, first), (_, second), *_ in (pair for pair in columns_of.values() if len(pair) > 1):
        mean = 0.5 * (first + second)
        # Position and velocity count alike.
        scale = np.repeat([np.linalg.norm(mean[:2]), np.linalg.norm(mean[2:])], 2)[:, None] + np.finfo(float).tiny
        returned = trial.prediction.covariance[:, :2] / scale
        factor = float(np.sum(returned * mean / scale) / max(np.sum(returned**2), np.finfo(float).tiny))
        targets.append(
            OwnCovariance(
                trial,
                mean,
                float(np.linalg.norm((first - second) / scale) / np.linalg.norm(mean / scale)),
                float(np.linalg.norm(mean / scale - factor * returned) / np.linalg.norm(mean / scale)),
            )
        )
    return targets


def _columns_by_gain(trial: Trial) -> Array | None:
    """Return the covariance ``(4, 2)`` of state and position implied by a gain; None where no position is measured."""
    # A curved model counts too: where the returned covariance is too large, the model may only seem curved.

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
