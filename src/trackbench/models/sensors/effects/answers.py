"""The methods of effects, and whether they return what they must."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from trackbench.base.errors import TrackbenchError
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array, Indices
from trackbench.models.sensors.effects.base import Effect, Sensed

if TYPE_CHECKING:
    from trackbench.models.sensors.base import Sensor

#: The arrays of a ``Sensed`` that an effect may change; each may be the same in all runs, but the error.
_ARRAYS = ("pose", "velocity", "yaw_rate", "visible", "probability", "scale", "slow_scale", "error", "bodies.target")


def before(effect: Effect, sensed: Sensed, random: RunStreams) -> Sensed:
    """What the effect makes of some runs, as its ``before``.

    Raises:
        TrackbenchError: it is no ``Sensed``, an array has another shape, or a value is no longer finite.
    """
    changed: Any = effect.before(sensed, random)
    if not isinstance(changed, Sensed):
        _refuse(effect, "before must return", f"a Sensed, as by sensed.replaced(...), not {_kind(changed)}")
    for name in _ARRAYS:
        array, unchanged = map(attrgetter(name), (changed, sensed))
        if array is unchanged:
            continue
        lasts = (sensed.runs,) if name == "error" else (sensed.runs, 1)
        firsts = (1, len(sensed.error)) if name.endswith("scale") else unchanged.shape[:1]
        shapes = [(first, *unchanged.shape[1:-1], last) for first in firsts for last in lasts]
        _require_like(effect, f"before must return a Sensed whose {name} is", array, unchanged, shapes)
    return changed


def after(effect: Effect, measurement: Array, sensor: Sensor) -> Array:
    """Measurements as the effect gives them, as its ``after``.

    Raises:
        TrackbenchError: they are no array of the same shape, or are no longer finite.
    """
    changed: Any = effect.after(measurement, sensor)
    if changed is not measurement:
        _require_like(effect, "after must return", changed, measurement, [measurement.shape])
    return np.asarray(changed)


def alarms(effect: Effect, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array] | None:
    """Further detections, as the effect's ``alarms``.

    Raises:
        TrackbenchError: they are not numbers of runs and instants and as many finite measurements.
    """
    answer: Any = effect.alarms(sensed, random)
    if answer is None:
        return None
    size = len(sensed.error)
    right = f"None, or the numbers of runs (n,) and of instants (n,) and measurements ({size}, n)"
    if not isinstance(answer, tuple) or len(answer) != 3 or not all(isinstance(part, np.ndarray) for part in answer):
        _refuse(effect, "alarms must return", f"{right} as three arrays, not {_kind(answer)}")
    run, instant, measurement = answer
    if run.ndim != 1 or instant.shape != run.shape or measurement.shape != (size, len(run)):
        shapes = f"{run.shape}, {instant.shape} and {measurement.shape}"
        _refuse(effect, "alarms must return", f"{right}, not arrays of shapes {shapes}")
    for name, number, count in (("a run", run, sensed.runs), ("an instant", instant, len(sensed.time))):
        if number.dtype.kind not in "iu" or (len(number) and not 0 <= number.min() <= number.max() < count):
            _refuse(effect, "alarms must return", f"{right}; {name} is a whole number from 0 to {count - 1}")
    if not np.isfinite(measurement).all():
        _refuse(effect, "alarms must return", f"{right}; a measurement is not finite")
    return run, instant, measurement


def _require_like(effect: Effect, what: str, changed: Any, before: Array, shapes: Sequence[tuple[int, ...]]) -> None:
    if not isinstance(changed, np.ndarray) or changed.dtype.kind not in "biuf":
        _refuse(effect, what, f"an array of numbers, not {_kind(changed)}")
    if changed.shape not in shapes:
        _refuse(effect, what, f"an array of shape {shapes[0]}, not {changed.shape}")
    if not (finite := np.isfinite(changed)).all() and (lost := np.isfinite(before) & ~finite).any():
        _refuse(effect, what, f"finite, not {np.broadcast_to(changed, lost.shape)[lost][0]}")


def _refuse(effect: Effect, what: str, right: str) -> NoReturn:
    raise TrackbenchError(f"effect {effect.type!r}: {what} {right}")


def _kind(value: Any) -> str:
    return "None" if value is None else f"a {type(value).__name__}"
