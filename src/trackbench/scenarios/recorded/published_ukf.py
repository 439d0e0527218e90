"""UKF of the published Udacity projects, with its faults.

The azimuths of the sigma points are averaged as plain numbers, also across the direction of -x, where they jump by
2 pi. If the covariance is then not positive definite, the Cholesky factor is incomplete: Eigen's LLT stops at the first
pivot that is not positive, and the program does not ask whether it succeeded. Not for use: it reproduces published
numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Scan
from trackbench.base.units import difference
from trackbench.filters import Belief, PredictedMeasurement, SigmaPointFilter, SymmetricSet, Update
from trackbench.filters.base import linear_update
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.builtin import build, ukf
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.late import LateScans
from trackbench.trackers.track_steps import TrackState


@dataclass(frozen=True)
class FaultyUkf(SigmaPointFilter):
    """Augmented UKF on CTRV with two faults: azimuths averaged as plain numbers, and a Cholesky that stops half way."""

    def predict(self, belief: Belief, dt: float) -> Belief:
        return super().predict(belief._replace(factor=stopped_cholesky(belief.covariance)), dt)

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        motion, sensor, points = self.motion, SENSOR_MODELS[scan.kind], belief.points
        if points is None:
            return super().predict_measurement(belief, scan)
        _, _, centre, other = self.rule.weights((points.shape[1] - 1) // 2)
        weights = np.full(points.shape[1], other)
        weights[0] = centre
        seen = sensor.measure(motion.to_cartesian(points), scan.sensor_pose, scan.sensor_velocity)
        expected = np.einsum("s,ms...->m...", weights, seen)
        deviations = difference(seen, expected[:, None], sensor.angular)
        state_deviations = difference(points, belief.mean[:, None], motion.angular)
        s = np.einsum("s,is...,js...->ij...", weights, deviations, deviations)
        cross = np.einsum("s,is...,js...->ij...", weights, deviations, state_deviations)
        return PredictedMeasurement(expected, s, cross)

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        if belief.points is None:
            return super().update(belief, scan, predicted)
        predicted = predicted or self.predict_measurement(belief, scan)
        return linear_update(belief, predicted, self.measured(scan), scan.valid, self.motion.angular)


class FaultyTracker(FilterTracker):
    """Tracker with the faulty UKF, whose published covariances are made positive definite."""

    def step(self, state: TrackState | None, scan: Scan) -> tuple[TrackState, Estimate]:
        state, estimate = super().step(state, scan)
        definite = linalg.ensure_definite(estimate.covariance)
        return state, estimate._replace(covariance=definite.covariance, repaired=definite.repaired)


def stopped_cholesky(matrix: Array) -> Array:
    """Return the lower factor ``(n, n, ...)``, unfinished from the first pivot on that is not positive."""
    size = len(matrix)
    lanes = np.moveaxis(matrix.reshape(size, size, -1), -1, 0).copy()
    for a in lanes:
        for k in range(size):
            pivot = a[k, k] - a[k, :k] @ a[k, :k]
            if pivot <= 0.0:
                break
            a[k, k] = np.sqrt(pivot)
            a[k + 1 :, k] = (a[k + 1 :, k] - a[k + 1 :, :k] @ a[k, :k]) / a[k, k]
    return np.moveaxis(np.tril(lanes), 0, -1).reshape(matrix.shape)


def faulty_ukf(**options: Any) -> LateScans:
    """Return a tracker with the UKF of the published projects, faults included; options are those of a built-in UKF."""
    sound = build(FilterConfig.model_validate({"filter": "ukf", **options})).tracker
    faulty = FaultyUkf(sound.filter.motions[0], SymmetricSet(1.0, 0.0, None))
    return LateScans(FaultyTracker(faulty, sound.initial, sensors=sound.sensors, advance_at=sound.advance_at))


faulty_ukf.Options = ukf.Options  # type: ignore[attr-defined]
