"""Constant errors of a sensor that explain what measurements have no innovation: a bias, a factor, a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.findings import Finding
from trackbench.subjects.doctor.right_answers import measurement_shown
from trackbench.subjects.doctor.trial import Trial
from trackbench.subjects.doctor.wrong_models import right_measurement

#: Share of the trials in which the measurement without an innovation has to be found.
MOST = 0.85
#: Distance from the fitted error in the median of the trials, in standard deviations of the measurement, and besides
#: as a share of that error.
SPREAD, SHARE = 0.5, 0.1
#: Time over which a target's measurement is differentiated, s.
SHORT = 1e-3


class SystematicFit(NamedTuple):
    """The offsets of all trials by one kind of error."""

    fault: str
    offsets: Array
    """``(trials, m)``"""
    size: Array
    """``(m,)`` the bias, the factor less 1, or the time in s of all components."""


def systematic_error(sensor: str, trials: Sequence[Trial], clear: float) -> Finding | None:
    """The kind of error that fits best what measurements have no innovation.

    Args:
        sensor: its name.
        trials: of that sensor.
        clear: offset of a component that is one, in standard deviations of the measurement.
    """
    pairs = [(trial, offset) for trial in trials if (offset := trial.offset()) is not None]
    if len(pairs) < MOST * len(trials):
        return None
    known, offsets = [trial for trial, _ in pairs], np.array([offset for _, offset in pairs])
    sigma = known[0].sigma
    bias = np.median(offsets, axis=0)
    candidates = (
        SystematicFit("sensor_bias", np.tile(bias, (len(offsets), 1)), bias),
        _scale(known, offsets),
        _time(known, offsets),
    )
    fits = [fit for fit in candidates if _good(fit, offsets, sigma, clear)]
    if not fits:
        return None
    best = min(fits, key=lambda fit: float(np.sum(_spread(fit, offsets, sigma) ** 2)))
    clearest = int(np.argmax(np.max(np.abs(offsets) / sigma, axis=1)))
    text, confidence, factor = _evidence(sensor, known, best, offsets, clear)
    exhibit = measurement_shown(known[clearest], known[clearest].predicted_measurement + offsets[clearest], clear)
    return Finding(best.fault, confidence, text, sensor=sensor, factor=factor, exhibit=exhibit)


def _scale(trials: Sequence[Trial], offsets: Array) -> SystematicFit:
    """By least squares; an angle has no scale."""
    predicted = np.array([trial.predicted_measurement for trial in trials])
    factor = np.sum(offsets * predicted, axis=0) / np.maximum(np.sum(predicted**2, axis=0), 1e-12)
    factor[list(SENSOR_MODELS[trials[0].scan.kind].angular)] = 0.0
    return SystematicFit("scale_error", factor * predicted, factor)


def _time(trials: Sequence[Trial], offsets: Array) -> SystematicFit:
    """By least squares of all components, each in its standard deviations."""
    rates = np.array([_rate(trial) for trial in trials])
    weighted = rates / trials[0].sigma ** 2
    delay = float(np.sum(offsets * weighted) / max(np.sum(rates * weighted), 1e-12))
    return SystematicFit("time_offset", delay * rates, np.full(offsets.shape[1], delay))


def _rate(trial: Trial) -> Array:
    """``(m,)`` change of the measurement by the target's motion, per second."""
    mean = trial.prediction.mean
    ahead, behind = (
        right_measurement(mean + np.array([*side * SHORT * mean[2:], 0.0, 0.0]), trial.scan) for side in (0.5, -0.5)
    )
    return np.asarray(difference(ahead, behind, SENSOR_MODELS[trial.scan.kind].angular) / SHORT)


def _spread(fit: SystematicFit, offsets: Array, sigma: Array) -> Array:
    """``(m,)`` median distance of the offsets from the fit, in sigma."""
    return np.asarray(np.median(np.abs(offsets - fit.offsets), axis=0) / sigma)


def _off(fit: SystematicFit, sigma: Array, clear: float) -> Mask:
    """``(m,)`` which components are off, in the median of the trials."""
    return np.asarray(np.median(np.abs(fit.offsets), axis=0) > clear * sigma)


def _good(fit: SystematicFit, offsets: Array, sigma: Array, clear: float) -> bool:
    allowed = SPREAD + SHARE * np.median(np.abs(fit.offsets), axis=0) / sigma
    return bool(_off(fit, sigma, clear).any()) and not np.any(_spread(fit, offsets, sigma) > allowed)


def _evidence(
    sensor: str, trials: Sequence[Trial], fit: SystematicFit, offsets: Array, clear: float
) -> tuple[str, float, float | None]:
    """The evidence for a fit, its confidence and its factor."""
    model, sigma = SENSOR_MODELS[trials[0].scan.kind], trials[0].sigma
    off = np.flatnonzero(_off(fit, sigma, clear))
    names = [model.components[i].replace("_", " ") for i in off]
    around = f"(spread {np.max(_spread(fit, offsets, sigma)[off]):.2g} sigma over {len(offsets)} trials)"
    if fit.fault == "scale_error":
        factors = [1.0 / (1.0 + fit.size[i]) for i in off]
        parts = ", ".join(f"{name} times {factor:.4g}" for name, factor in zip(names, factors, strict=True))
        return f"the tracker takes the measurements of {sensor} as {parts} {around}", 0.92, factors[0]
    if fit.fault == "time_offset":
        delay = float(fit.size[0])
        when = "after" if delay > 0.0 else "before"
        text = (
            f"a measurement of {sensor} has no innovation where the target is {1e3 * abs(delay):.2g} ms {when} the "
            f"time of the scan {around}"
        )
        return text, 0.92, None
    parts = ", ".join(
        f"{name} {fit.size[i]:+.3g} {'rad' if i in model.angular else 'm or m/s'}"
        for name, i in zip(names, off, strict=True)
    )
    return f"the predicted measurement has a constant bias: {parts} {around}", 0.9, None
