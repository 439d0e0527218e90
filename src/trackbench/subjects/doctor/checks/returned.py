"""Is the covariance that is returned the one that the gains are made of?

With ``K = P H^T (H P H^T + R)^-1`` the columns ``P H^T`` are ``K (I - H K)^-1 R``. So the covariance of the whole state
with the position follows from a gain alone. Where it is the same by two sensors, it is the tracker's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.checks.drives import harmless
from trackbench.subjects.doctor.exhibits import STATE, Matrices, Panel
from trackbench.subjects.doctor.findings import Finding
from trackbench.subjects.doctor.output_checks import least_eigenvalue
from trackbench.subjects.doctor.samples import has_samples
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial

#: Difference of the covariances by two sensors, relative to them, up to which they are one: 0.00 with a Kalman filter,
#: sigma points or not, 0.03 with several models.
ONE = 0.08
#: Difference from the returned one, but for a factor, from which on that is another. A factor is also that of a
#: measurement noise.
OTHER = 0.2
#: Least number of targets at which both are known.
LEAST = 3


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
    panels = (Panel("returned", returned), Panel("by the gains", clearest.own, "right"))
    title = f"Covariance with the position, predicted: {clearest.trial.description}"
    exhibit = Matrices(title, STATE, STATE[:2], panels, ())
    return Finding("wrong_covariance_returned", 0.96, text, shown_by="own_model", exhibit=exhibit)


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
