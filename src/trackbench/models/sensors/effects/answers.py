"""Calls of the methods of effects, with checks of the returned values."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np

from trackbench.base.answers import require, require_array
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array, Indices
from trackbench.models.sensors.effects.base import Effect, Sensed
from trackbench.models.sensors.model import SensorModel

#: Arrays of a ``Sensed`` that an effect may change. All but the error may have one value for all runs.
_ARRAYS = ("pose", "velocity", "yaw_rate", "visible", "probability", "scale", "slow_scale", "error", "bodies.target")


def before(effect: Effect, sensed: Sensed, random: RunStreams) -> Sensed:
    """Apply an effect's ``before`` to the scans, and check the value that it returns.

    Raises:
        TrackbenchError: the value is no ``Sensed``, an array has another shape, or a value is no longer finite.
    """
    changed: Any = effect.before(sensed, random)
    require(
        isinstance(changed, Sensed),
        f"effect {effect.type!r}: what before returns",
        "a Sensed, as by sensed.replaced(...)",
        changed,
    )
    for name in _ARRAYS:
        array, unchanged = map(attrgetter(name), (changed, sensed))
        if array is unchanged:
            continue
        lasts = (sensed.runs,) if name == "error" else (sensed.runs, 1)
        firsts = (1, len(sensed.error)) if name.endswith("scale") else unchanged.shape[:1]
        shapes = [(first, *unchanged.shape[1:-1], last) for first in firsts for last in lasts]
        require_array(f"effect {effect.type!r}: {name} of what before returns", array, shapes, np.isfinite(unchanged))
    result: Sensed = changed
    return result


def after(effect: Effect, measurement: Array, sensor: SensorModel) -> Array:
    """Apply an effect's ``after`` to the measurements, and check the value that it returns.

    Raises:
        TrackbenchError: the value is no array of the measurements' shape, or has numbers that are no longer finite.
    """
    changed: Any = effect.after(measurement, sensor)
    if changed is not measurement:
        what = f"effect {effect.type!r}: what after returns"
        require_array(what, changed, [measurement.shape], np.isfinite(measurement))
    return np.asarray(changed)


def alarms(effect: Effect, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array] | None:
    """Return the false alarms that an effect's ``alarms`` adds, after a check of their arrays; None for no alarms.

    Raises:
        TrackbenchError: the value is not a tuple of run indices, instant indices and as many finite measurements.
    """
    answer: Any = effect.alarms(sensed, random)
    if answer is None:
        return None
    size, what = len(sensed.error), "what alarms returns"
    right = f"None, or the numbers of runs (n,) and of instants (n,) and measurements ({size}, n)"
    require(isinstance(answer, tuple) and len(answer) == 3, f"effect {effect.type!r}: {what}", right, answer)
    run, instant, measurement = answer
    counts = np.shape(run)[:1]
    for part, number, count in (("runs", run, sensed.runs), ("instants", instant, len(sensed.time))):
        which = f"effect {effect.type!r}: the {part} of {what}"
        require_array(which, number, [counts])
        is_whole = number.dtype.kind in "iu" and bool(((number >= 0) & (number < count)).all())
        require(is_whole, which, f"whole numbers from 0 to {count - 1}", number.tolist())
    require_array(f"effect {effect.type!r}: the measurements of {what}", measurement, [(size, *counts)])
    return run, instant, measurement
