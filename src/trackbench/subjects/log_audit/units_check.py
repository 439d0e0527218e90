"""Whether a component is in another unit than the scenario says, or counts the other way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.subjects.log_audit.sensor_log import SensorLog
from trackbench.truth.config.columns import COMPONENT_QUANTITIES, UNITS, MeasurementColumns

#: Another unit must make the spread of the residuals smaller by this factor.
CLEARLY = 3.0


@dataclass(frozen=True)
class WrongUnit:
    """A component that fits the truth in another unit."""

    component: str
    stated: str
    fits: str
    """The unit in which it fits."""
    turned: bool
    """Whether it also counts the other way."""
    factor: float
    """What the measurement, as read, is to be multiplied by."""
    spread: tuple[float, float]
    """Spread of the residuals as stated and in the other unit, SI units and rad."""


def wrong_units(log: SensorLog) -> Iterator[WrongUnit]:
    """The components whose residuals get clearly smaller in another unit."""
    entry = log.truth.measurements.get(log.name) or MeasurementColumns()
    expected = log.expected({})
    for i, (name, unit) in enumerate(zip(log.components, log.config.units, strict=True)):
        quantity = COMPONENT_QUANTITIES.get(unit)
        if quantity is None:
            continue
        known = np.isfinite(expected[i])
        measured, wanted, circular = log.measurement[i, known], expected[i, known], i in log.config.angular
        stated = entry.units.get(name) or str(getattr(log.truth.units, quantity))
        as_read = _spread(measured, wanted, circular)
        choices = {
            (other, turned): UNITS[quantity][other] / UNITS[quantity][stated] * (-1.0 if turned else 1.0)
            for other in UNITS[quantity]
            for turned in (False, True)
        }
        spreads = {choice: _spread(factor * measured, wanted, circular) for choice, factor in choices.items()}
        best = min(spreads, key=spreads.__getitem__)
        # What has become nearly zero fits as well as the truth itself changes.
        own = _spread(np.zeros_like(wanted), wanted, circular)
        if best != (stated, False) and CLEARLY * spreads[best] < min(as_read, own):
            yield WrongUnit(name, stated, best[0], best[1], choices[best], (as_read, spreads[best]))


def _spread(measured: Array, wanted: Array, circular: bool) -> float:
    """Median distance of the residuals from their middle."""
    residual = measured - wanted
    if circular:
        middle = np.angle(np.mean(np.exp(1j * residual)))
        residual = wrap_angle(residual - middle)
    return float(np.median(np.abs(residual - np.median(residual)))) if len(residual) else 0.0
