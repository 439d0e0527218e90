"""The methods of effects, and whether they return what they must."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from trackbench.base.errors import TrackbenchError
from trackbench.base.types import Array, Indices
from trackbench.models.sensors.effects.base import Effect, Sensed

if TYPE_CHECKING:
    from trackbench.models.sensors.base import Sensor

#: The arrays of a ``Sensed`` that an effect may change.
_ARRAYS = ("pose", "velocity", "visible", "probability", "scale", "error", "bodies.target")


def before(effect: Effect, sensed: Sensed, random: np.random.Generator) -> Sensed:
    """What the effect makes of one run, as its ``before``.

    Raises:
        TrackbenchError: it is no ``Sensed``, an array has another shape, or a value is no longer finite.
    """
    changed: Any = effect.before(sensed, random)
    if not isinstance(changed, Sensed):
        _refuse(effect, "before", f"a Sensed, as by sensed.replaced(...), not {_kind(changed)}")
    for name in _ARRAYS:
        arrays = map(attrgetter(name), (changed, sensed))
        _require_like(effect, f"before must return a Sensed whose {name} is", *arrays)
    return changed


def after(effect: Effect, measurement: Array, sensor: Sensor) -> Array:
    """Measurements as the effect gives them, as its ``after``.

    Raises:
        TrackbenchError: they are no array of the same shape, or are no longer finite.
    """
    changed: Any = effect.after(measurement, sensor)
    _require_like(effect, "after must return", changed, measurement)
    return np.asarray(changed)


def alarms(effect: Effect, sensed: Sensed, random: np.random.Generator) -> tuple[Indices, Array] | None:
    """Further detections, as the effect's ``alarms``.

    Raises:
        TrackbenchError: they are not numbers of instants and as many finite measurements.
    """
    given: Any = effect.alarms(sensed, random)
    if given is None:
        return None
    size, instants = len(sensed.error), len(sensed.time)
    right = f"None, or the numbers of instants (n,) and measurements ({size}, n)"
    if not isinstance(given, tuple) or len(given) != 2 or not all(isinstance(part, np.ndarray) for part in given):
        _refuse(effect, "alarms", f"{right} as two arrays, not {_kind(given)}")
    instant, measurement = given
    if instant.ndim != 1 or measurement.shape != (size, len(instant)):
        _refuse(effect, "alarms", f"{right}, not arrays of shapes {instant.shape} and {measurement.shape}")
    if instant.dtype.kind not in "iu" or (len(instant) and not 0 <= instant.min() <= instant.max() < instants):
        _refuse(effect, "alarms", f"{right}; an instant is a whole number from 0 to {instants - 1}")
    if not np.isfinite(measurement).all():
        _refuse(effect, "alarms", f"{right}; a measurement is not finite")
    return instant, measurement


def _require_like(effect: Effect, what: str, changed: Any, given: Array) -> None:
    if changed is given:
        return
    if not isinstance(changed, np.ndarray) or changed.dtype.kind not in "biuf":
        raise TrackbenchError(f"effect {effect.type!r}: {what} an array of numbers, not {_kind(changed)}")
    if changed.shape != given.shape:
        raise TrackbenchError(f"effect {effect.type!r}: {what} an array of shape {given.shape}, not {changed.shape}")
    lost = np.isfinite(given) & ~np.isfinite(changed)
    if lost.any():
        raise TrackbenchError(f"effect {effect.type!r}: {what} finite, not {changed[lost][0]}")


def _refuse(effect: Effect, method: str, right: str) -> NoReturn:
    raise TrackbenchError(f"effect {effect.type!r}: {method} must return {right}")


def _kind(value: Any) -> str:
    return "None" if value is None else f"a {type(value).__name__}"
