"""A recording cut into stretches of time, each of which is a scene."""

from __future__ import annotations

from dataclasses import fields, replace
from decimal import Decimal
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import (
    KINEMATICS,
    Mask,
    Observer,
    RecordedAlarms,
    RecordedDetections,
    RecordedMeasurements,
    Truth,
)
from trackbench.truth.base import Recorded

#: s.
SHORTEST = 4.0


def stretch(truth: Truth, recorded: dict[str, Recorded], number: int, count: int) -> tuple[Truth, dict[str, Recorded]]:
    """One of so many stretches of equal time between the first and the last scan; its times begin at 0 s.

    Raises:
        InputError: it is too short, or a sensor has no scan in it.
    """
    scans = truth.time[np.concatenate([own.steps for own in recorded.values()])]
    first, last = float(scans.min()), float(scans.max())
    length = (last - first) / count
    if length < SHORTEST:
        message = f"{count} stretches of {last - first:.3g} s are shorter than {SHORTEST:g} s each"
        raise InputError(f"{message}; at most {int((last - first) / SHORTEST)}", key="truth.stretches")
    start, end = first + number * length, first + (number + 1) * length
    chosen = (truth.time >= start) & ((truth.time <= end) if number == count - 1 else (truth.time < end))
    for name, own in recorded.items():
        if not chosen[own.steps].any():
            message = f"{name} has no scan from {start:.3g} to {end:.3g} s; take fewer"
            raise InputError(message, key="truth.stretches")
    return _cut(truth, chosen), {name: _scans(own, chosen) for name, own in recorded.items()}


def _cut(truth: Truth, chosen: Mask) -> Truth:
    time, unscored = truth.time[chosen], truth.unscored
    arrays = [(item.name, getattr(truth.observer, item.name)) for item in fields(Observer)]
    observer: dict[str, Any] = {name: values[chosen] for name, values in arrays if isinstance(values, np.ndarray)}
    if unscored is not None:
        boxes = unscored.boxes.copy()
        boxes[:2] -= time[0]
        unscored = unscored._replace(boxes=boxes)
    return replace(
        truth,
        time=time - time[0],
        **{name: getattr(truth, name)[chosen] for name in (*KINEMATICS, "alive")},
        observer=replace(truth.observer, **observer),
        unscored=unscored,
        start=truth.start + Decimal(repr(float(time[0]))),
    )


def _scans(own: Recorded, chosen: Mask) -> Recorded:
    kept, step = chosen[own.steps], np.cumsum(chosen) - 1
    number = np.cumsum(kept) - 1
    steps = step[own.steps[kept]]
    if isinstance(own, RecordedDetections):
        there = kept[own.scan]
        return own._replace(
            steps=steps,
            scan=number[own.scan[there]],
            measurement=own.measurement[:, there],
            own_track=own.own_track[there],
        )
    alarms = own.alarms
    if alarms is not None:
        there = kept[alarms.scan]
        alarms = RecordedAlarms(number[alarms.scan[there]], alarms.measurement[:, there])
    cycle = None if own.cycle is None else own.cycle[kept]
    return RecordedMeasurements(steps, own.measurement[:, kept], own.valid[kept], cycle, alarms)
