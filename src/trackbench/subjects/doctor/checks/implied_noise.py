"""Do a tracker's gains imply the measurement noise that the sensor states?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.expected_gain import ImpliedModel, SamplingErrors, variance_of_ray
from trackbench.subjects.doctor.findings import Finding

#: Largest ratio of the implied to the stated variance, either way, that is a reasonable tuning.
NOISE_BAND = 2.0
#: Ratio of variances in degrees to variances in radians, ratio of variances that were converted to radians twice, and
#: largest error of the logarithm of such a ratio.
IN_DEGREES, NEAR = ((180.0 / np.pi) ** 2, (np.pi / 180.0) ** 2), 0.35
#: Largest error of the logarithm of a ratio of variances that a confusion of units explains.
SAME = 0.02
#: Largest error of the direction of a Jacobian row, scaled by the standard deviations. Sigma points reach 0.04.
DIRECTION = 0.08
#: Standard errors by which random samples of a tracker widen a threshold; 3 are exceeded by chance in 0.3 % of cases.
ERRORS = 3.0


def _noises(rows: Sequence[ImpliedModel]) -> Array:
    """Return implied divided by stated noise variances ``(n, m)`` of n trials; NaN where a Jacobian row is wrong."""
    return np.array([np.where(row.direction < 2 * DIRECTION, row.noise, np.nan) for row in rows])


def noise_factors(rows: Sequence[ImpliedModel]) -> Array:
    """Return median ratios ``(m,)`` of implied to stated variances over the trials; NaN with fewer than 3 trials."""
    noise = _noises(rows)
    is_known = np.isfinite(noise).sum(axis=0) >= 3
    return np.array([np.nanmedian(noise[:, i]) if is_known[i] else np.nan for i in range(noise.shape[1])])


def wrong_noise(sensor: str, rows: Sequence[ImpliedModel], errors: SamplingErrors) -> list[Finding]:
    """Report the variances implied by a sensor's gains that are too small or too large."""
    model, sigma = SENSOR_MODELS[rows[0].trial.scan.kind], rows[0].trial.sigma
    factors, noise = noise_factors(rows), _noises(rows)
    band = NOISE_BAND * np.exp(ERRORS * np.nan_to_num(errors.noise))
    most = np.maximum(band, variance_of_ray(model.components, sigma))
    is_wrong = (factors < 1 / band) | (factors > most)
    for i in model.angular:
        exact = next((ratio for ratio in IN_DEGREES if abs(np.log(factors[i] / ratio)) < NEAR), None)
        if exact is not None and not np.delete(is_wrong, i).any():
            words = "in degrees" if exact > 1.0 else "converted to radians twice"
            text = (
                f"the gains imply {factors[i]:.4g} times the stated variance of the {model.components[i]}, near the "
                f"{exact:.4g} of a standard deviation {words}"
            )
            factor = float(factors[i])
            return [Finding("degrees_for_radians", 0.95, text, sensor=sensor, factor=factor)]
    findings = []
    for fault, wrong, words in (
        ("r_too_small", factors < 1 / band, "smaller"),
        ("r_too_large", factors > most, "larger"),
    ):
        if not wrong.any():
            continue
        factor = float(np.exp(np.mean(np.log(factors[wrong]))))
        parts = ", ".join(
            f"{model.components[i].replace('_', ' ')} {np.sqrt(factors[i]) * sigma[i]:.3g} instead of {sigma[i]:.3g}"
            for i in np.flatnonzero(wrong)
        )
        text = (
            f"the gains imply a variance {max(factor, 1 / factor):.3g} times {words} than the one that {sensor} states "
            f"(standard deviations: {parts}){_confused_with_deviations(noise, sigma, np.flatnonzero(wrong))}"
        )
        confidence = min(0.98, 0.6 + 0.2 * abs(np.log(factor)) / np.log(4))
        findings.append(Finding(fault, confidence, text, sensor=sensor, factor=factor))
    return findings


def _confused_with_deviations(noise: Array, sigma: Array, wrong: Indices) -> str:
    """Return a note that standard deviations are used as variances, if that explains all ratios; else an empty text."""
    medians = np.array([np.nanmedian(noise[:, i]) for i in wrong])
    return ": standard deviations used as variances" if np.all(np.abs(np.log(medians * sigma[wrong])) < SAME) else ""
