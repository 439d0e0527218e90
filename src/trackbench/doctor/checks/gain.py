"""Do the tracker's gains and covariances imply the right Jacobian and measurement noise?

In a Kalman filter ``P^-1 K = H^T R^-1``, and a measurement adds the information ``P^-1 - P_predicted^-1 = H^T R^-1 H``
(Bar-Shalom, Li and Kirubarajan 2001, section 5.2.3). H and R follow from the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.doctor.findings import CheckResult, Finding, PartResult
from trackbench.doctor.tracker_under_test import TrackerUnderTest
from trackbench.doctor.trial import Trial, TrialUpdate
from trackbench.doctor.wrong_models import DEGREE
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array, Mask

#: Ratio of the implied to the stated variance that still is a reasonable tuning.
NOISE_BAND = 2.0
#: Error of the direction of a row of the Jacobian, scaled by the standard deviations. Sigma points reach 0.04.
DIRECTION = 0.08
#: Error of the length of a row, as a ratio. Sigma points reach 1.25.
SIZE = 1.7
#: Curvature of the measurement model from which on a correct gain may differ from that of the Jacobian, in sigma.
CURVED = 0.3
#: Share of the change of the covariance outside the column space of the gain: up to 0.01 with sigma points, 0.08 and
#: more with fixed gains.
OUTSIDE = 0.05


class ImpliedModel(NamedTuple):
    """The measurement model and noise that one update implies, for each component of the measurement."""

    trial: Trial
    used: Mask
    noise: Array
    """``(m,)`` implied over stated variance; NaN where the row points away from the right one."""
    direction: Array
    """``(m,)`` distance between the unit vectors along the implied and the right row."""
    size: Array
    """``(m,)`` length of the implied row along the right one, over the right length."""
    jacobian: Array
    """``(m, 4)`` the implied Jacobian."""


def gain(tracker: TrackerUnderTest) -> PartResult:
    """Compute the implied Jacobian and noise at the regular probes, and compare with the right ones."""
    result = PartResult()
    for sensor, trials in tracker.trials.items():
        name, question = f"gain.{sensor}", f"Do the gains for {sensor} fit its geometry and its stated noise?"
        linear = [trial for trial in trials if trial.curvature.max() < CURVED]
        rows = [row for trial in linear if (row := _implied(trial)) is not None]
        if len(rows) < 3 or len(rows) < 0.5 * len(linear):
            why = (
                "the predictions are too uncertain" if len(linear) < 3 else "the gains are not those of a Kalman filter"
            )
            result.checks.append(CheckResult(name, question, None, why))
            continue
        result.findings += _jacobian(sensor, rows)
        result.findings += _noise(sensor, rows)
        result.checks.append(CheckResult(name, question, not result.findings, _result(rows)))
    return result


def _implied(trial: Trial) -> ImpliedModel | None:
    update = trial.update(trial.predicted_measurement)
    if update is None or update.information is None or not update.used.any() or not _is_kalman(update):
        return None
    h, spread, sigma = trial.jacobian, trial.state_sigma, trial.sigma
    scaled, implied = h * spread, update.information.T * spread
    along, length = np.einsum("ij,ij->i", implied, scaled), np.einsum("ij,ij->i", scaled, scaled)
    noise = np.full(len(sigma), np.nan)
    direction, size = np.full(len(sigma), np.nan), np.full(len(sigma), np.nan)
    before = linalg.symmetrise(trial.prediction.covariance)
    if not np.linalg.eigvalsh(before)[0] > 0.0:
        return None
    added = np.linalg.inv(linalg.symmetrise(update.estimate.covariance)) - np.linalg.inv(before)
    jacobian = np.full_like(h, np.nan)
    used = update.used
    jacobian[used] = np.linalg.pinv(update.information[:, used], rcond=1e-9) @ added
    for i in np.flatnonzero(used):
        unit = implied[i] / np.linalg.norm(implied[i])
        direction[i] = np.linalg.norm(unit - scaled[i] / np.sqrt(length[i]))
        size[i] = float((jacobian[i] * spread) @ scaled[i] / length[i])
        if along[i] > 0.0:
            noise[i] = length[i] / along[i] / sigma[i] ** 2
    return ImpliedModel(trial, used, noise, direction, size, jacobian)


def _is_kalman(update: TrialUpdate) -> bool:
    """Whether the covariance changes only in the column space of the gain; with a fixed gain it does not."""
    spread = update.trial.state_sigma
    change = (update.trial.prediction.covariance - update.estimate.covariance) / np.outer(spread, spread)
    base = np.linalg.qr(update.relative_gain[:, update.used])[0]
    outside = change - base @ (base.T @ change)
    size = float(np.linalg.norm(change))
    return size > 1e-9 and float(np.linalg.norm(outside)) < OUTSIDE * size


def _jacobian(sensor: str, rows: Sequence[ImpliedModel]) -> list[Finding]:
    model = SENSOR_MODELS[rows[0].trial.scan.kind]
    found = []
    for i, component in enumerate(model.components):
        of = [row for row in rows if row.used[i]]
        if len(of) < 3:
            continue
        direction = np.array([row.direction[i] for row in of])
        size = np.array([row.size[i] for row in of])
        # The second-order terms of sigma points have a larger share where the variance is far from the stated one.
        noise = float(np.nanmedian([row.noise[i] for row in of]))
        tolerance = max(noise, 1.0 / noise) ** 0.5 if noise > 0.0 else 1.0
        turned = direction > DIRECTION * tolerance
        scaled = (size > SIZE * tolerance) | (size < 1 / (SIZE * tolerance))
        if np.mean(turned) < 0.12 and np.mean(scaled) < 0.4:
            continue
        worst = max(of, key=lambda row: _apart(row, i))
        gap = (worst.jacobian[i] - worst.trial.jacobian[i]) * worst.trial.state_sigma
        j = int(np.argmax(np.abs(gap)))
        state = ("px", "py", "vx", "vy")[j]
        at = ", ".join(f"{value:.1f}" for value in worst.trial.prediction.mean)
        text = (
            f"the gain implies d {component} / d {state} = {worst.jacobian[i, j]:.3g}, where "
            f"{worst.trial.jacobian[i, j]:.3g} is right (px, py, vx, vy = {at}); its row is off by "
            f"{np.median(direction):.0%} in direction and {np.median(size):.3g} in length (medians of {len(of)} trials)"
        )
        share = max(float(np.mean(turned)), float(np.mean(scaled)))
        found.append(Finding("jacobian_wrong", 0.8 + 0.15 * share, text, sensor=sensor, shown_by=worst.trial.name))
    return sorted(found, key=lambda finding: finding.confidence, reverse=True)[:1]


def _apart(row: ImpliedModel, i: int) -> float:
    gap = (row.jacobian[i] - row.trial.jacobian[i]) * row.trial.state_sigma
    return float(np.max(np.abs(gap)) / np.linalg.norm(row.trial.jacobian[i] * row.trial.state_sigma))


def _factors(rows: Sequence[ImpliedModel]) -> Array:
    """``(m,)`` medians of the implied over the stated variances; NaN where there are too few."""
    noise = np.array([np.where(row.direction < 2 * DIRECTION, row.noise, np.nan) for row in rows])
    known = np.isfinite(noise).sum(axis=0) >= 3
    return np.array([np.nanmedian(noise[:, i]) if known[i] else np.nan for i in range(noise.shape[1])])


def _noise(sensor: str, rows: Sequence[ImpliedModel]) -> list[Finding]:
    model = SENSOR_MODELS[rows[0].trial.scan.kind]
    factors = _factors(rows)
    found = []
    for i in model.angular:
        for words, factor in (("in degrees", DEGREE**2), ("converted to radians twice", DEGREE**-2)):
            others = np.delete(factors, i)
            alone = np.all((others < NOISE_BAND) & (others > 1 / NOISE_BAND) | ~np.isfinite(others))
            if alone and 0.7 < factors[i] / factor < 1.4:
                text = (
                    f"the gains imply {factors[i]:.4g} times the stated variance of the {model.components[i]}, near "
                    f"{'(180/pi)^2' if factor > 1 else '(pi/180)^2'} = {factor:.4g}: a standard deviation {words}"
                )
                return [Finding("degrees_for_radians", 0.95, text, sensor=sensor, factor=float(factors[i]))]
    for fault, off, words in (
        ("r_too_small", factors < 1 / NOISE_BAND, "smaller"),
        ("r_too_large", factors > NOISE_BAND, "larger"),
    ):
        if not off.any():
            continue
        factor = float(np.exp(np.mean(np.log(factors[off]))))
        parts = ", ".join(
            f"{model.components[i].replace('_', ' ')} {np.sqrt(factors[i]) * rows[0].trial.sigma[i]:.3g} instead of "
            f"{rows[0].trial.sigma[i]:.3g}"
            for i in np.flatnonzero(off)
        )
        text = (
            f"the gains imply a variance {max(factor, 1 / factor):.3g} times {words} than the one that {sensor} states "
            f"(standard deviations: {parts})"
        )
        confidence = min(0.98, 0.6 + 0.2 * abs(np.log(factor)) / np.log(4))
        found.append(Finding(fault, confidence, text, sensor=sensor, factor=factor))
    return found


def _result(rows: Sequence[ImpliedModel]) -> str:
    names = SENSOR_MODELS[rows[0].trial.scan.kind].components
    parts = [
        f"{name.replace('_', ' ')} {factor:.3g}"
        for name, factor in zip(names, _factors(rows), strict=True)
        if np.isfinite(factor)
    ]
    direction = np.nanmax([np.nanmax(row.direction[row.used]) for row in rows])
    return (
        f"implied over stated variance: {', '.join(parts) or 'n/a'}; directions of the rows of the implied Jacobian "
        f"within {direction:.1%}"
    )
