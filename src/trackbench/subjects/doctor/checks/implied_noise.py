"""Do a tracker's gains imply the measurement noise that the sensor states?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.subjects.doctor.expected_gain import ImpliedModel, SamplingErrors, variance_of_ray
from trackbench.subjects.doctor.findings import Finding
from trackbench.subjects.doctor.units_ratio import LEAST, conversion

#: Ratio of the implied to the stated variance that still is a reasonable tuning.
NOISE_BAND = 2.0
#: Error of the direction of a row of the Jacobian, scaled by the standard deviations. Sigma points reach 0.04.
DIRECTION = 0.08
#: Standard errors of a tracker's own samples by which a threshold is wider; 3 are exceeded by chance in 0.3 % of cases.
ERRORS = 3.0
#: Distance of a ratio from two within which the noise is taken to be added twice. Sigma points move it by 0.04.
TWICE = 0.08


def _noises(rows: Sequence[ImpliedModel]) -> Array:
    """``(n, m)`` implied over stated variances; NaN where a row points elsewhere."""
    return np.array([np.where(row.direction < 2 * DIRECTION, row.noise, np.nan) for row in rows])


def noise_factors(rows: Sequence[ImpliedModel]) -> Array:
    """``(m,)`` medians of the implied over the stated variances; NaN where there are too few."""
    noise = _noises(rows)
    known = np.isfinite(noise).sum(axis=0) >= 3
    return np.array([np.nanmedian(noise[:, i]) if known[i] else np.nan for i in range(noise.shape[1])])


def wrong_noise(sensor: str, rows: Sequence[ImpliedModel], errors: SamplingErrors) -> list[Finding]:
    """What the variances that a sensor's gains imply are too small or too large for."""
    model, sigma = SENSOR_MODELS[rows[0].trial.scan.kind], rows[0].trial.sigma
    factors, noise = noise_factors(rows), _noises(rows)
    band = NOISE_BAND * np.exp(ERRORS * np.nan_to_num(errors.noise))
    most = np.maximum(band, variance_of_ray(model.components, sigma))
    off = (factors < 1 / band) | (factors > most)
    for i in model.angular:
        unit = conversion(factors[i], 0.35, power=2, quantities=("angle",)) if np.isfinite(factors[i]) else None
        if unit is not None and not np.delete(off, i).any():
            words = "in degrees" if unit.exact > 1.0 else "converted to radians twice"
            text = (
                f"the gains imply {factors[i]:.4g} times the stated variance of the {model.components[i]}, near "
                f"{unit.formula} = {unit.exact:.4g}: a standard deviation {words}"
            )
            factor = float(factors[i])
            return [Finding("degrees_for_radians", 0.95, text, sensor=sensor, factor=factor)]
    known = factors[np.isfinite(factors)]
    if len(known) > 1 and np.all(np.abs(known - 2.0) < TWICE):
        text = f"the gains imply {', '.join(f'{one:.3g}' for one in known)} times the stated variances of {sensor}: "
        text += "the measurement noise is added to the innovation covariance twice"
        return [Finding("measurement_noise_twice", 0.9, text, sensor=sensor, factor=2.0)]
    found = []
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
            f"(standard deviations: {parts}){_unit_of_noise(noise, sigma, np.flatnonzero(wrong), model)}"
        )
        confidence = min(0.98, 0.6 + 0.2 * abs(np.log(factor)) / np.log(4))
        found.append(Finding(fault, confidence, text, sensor=sensor, factor=factor))
    return found


def _unit_of_noise(noise: Array, sigma: Array, wrong: Indices, model: type[Sensor]) -> str:
    """That variances are wrong by a unit, or are standard deviations, if all of them are."""
    columns = [noise[np.isfinite(noise[:, i]), i] for i in wrong]
    medians, errors = np.array([np.median(of) for of in columns]), max(uncertainty(of) for of in columns)
    if np.all(np.abs(np.log(medians * sigma[wrong])) < max(errors, LEAST)):
        return ": standard deviations used as variances"
    quantities = ["speed" if model.components[i] == "range_rate" else "length" for i in wrong]
    units = {
        conversion(float(one), errors, power=2, quantities=[quantity])
        for one, quantity in zip(medians, quantities, strict=True)
    }
    unit = units.pop()
    return "" if units or unit is None else f": {unit.words}"


def uncertainty(ratios: Array) -> float:
    """Standard error of the median, relative to it, by the median deviation of a normal distribution."""
    logs = np.log(ratios)
    return float(1.25 * 1.48 * np.median(np.abs(logs - np.median(logs))) / np.sqrt(len(logs)))
