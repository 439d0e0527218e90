"""Where the sensors of a log lie on a map: by the noise, rate and detections that its audit sensor."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from trackbench.base.config.key_units import split_key
from trackbench.base.errors import InputError
from trackbench.base.files import read_json
from trackbench.results.metric_value import ResultModel
from trackbench.scenario import Scenario
from trackbench.subjects.envelope.axes import MapAxis, Point, Value
from trackbench.subjects.envelope.config import axis_keys

#: Of ``trackbench audit``.
AUDIT = "audit.json"


class AuditedLog(ResultModel):
    """A log by what its audit says of the axes of a map."""

    name: str
    """Of the scenario that was audited."""
    values: dict[str, float]
    """By axis, in its unit; some axes may be none of the audit's."""


def audited_log(place: Path, loaded: Scenario, axes: Sequence[MapAxis]) -> AuditedLog:
    """What an audit says of the axes.

    Args:
        place: the folder of an audit, or its ``audit.json``.
        loaded: the scenario of the map, whose sensors are those of the log.
        axes: of the map.

    Raises:
        InputError: it is no audit, or says nothing of any axis.
    """
    file = place / AUDIT if place.is_dir() else place
    try:
        raw = read_json(file)
        measured = dict(_audited(raw["sensors"], loaded))
        name = str(raw["scenario"])
    except FileNotFoundError:
        raise InputError(f"there is no {AUDIT}; `trackbench audit LOG` writes one", file=file) from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(f"not a readable {AUDIT} of `trackbench audit`", file=file) from None
    values = {axis.name: value for axis in axes if (value := _on_axis(axis, measured)) is not None}
    if not values:
        varied = ", ".join(key for axis in axes for key in axis_keys(axis.config))
        has = ", ".join(measured) or "nothing of the scenario's sensors"
        raise InputError(f"the audit says nothing of any axis: it has {has}; the axes vary {varied}", file=file)
    return AuditedLog(name=name, values=values)


def _audited(sensors: Mapping[str, Any], loaded: Scenario) -> Iterator[tuple[str, float]]:
    """By key of the scenario, in the key's unit, what was found."""
    for name, config in loaded.config.sensors.items():
        sensor = sensors.get(name)
        if sensor is None:
            continue
        noise = sensor.get("components") or {}
        for option in dict.fromkeys(config.sigma_options):
            own = [part for part, key in zip(config.components, config.sigma_options, strict=True) if key == option]
            sigmas = [noise[part]["sigma"]["value"] for part in own if part in noise]
            unit = split_key(option)[1]
            if sigmas and unit is not None and None not in sigmas:
                # Of an option that stands for several components, their root mean square.
                rms = math.sqrt(sum(sigma**2 for sigma in sigmas) / len(sigmas))
                yield f"sensors.{name}.{option}", rms / unit.factor
        for option, value in (("rate_hz", sensor["rate_hz"]), ("detection_probability", sensor["detections"]["value"])):
            if value is not None:
                yield f"sensors.{name}.{option}", float(value)


def _on_axis(axis: MapAxis, measured: Mapping[str, float]) -> float | None:
    """Where an axis of numbers has what was found; of several keys that follow it, the mean of those that are known."""
    if not axis.ordered:
        return None
    values = [link.value(measured[key]) for key, link in axis.links.items() if key in measured]
    return sum(values) / len(values) if values else None


def log_values(log: AuditedLog, own: Mapping[str, Value | None]) -> dict[str, Value | None]:
    """By axis the log's value; the scenario's own where the audit says nothing."""
    return {**own, **log.values}


def outside(log: AuditedLog, axes: Sequence[MapAxis]) -> str:
    """On which axis the map does not reach as far as the log; empty where it does."""
    for axis in axes:
        value = log.values.get(axis.name)
        if value is not None and not axis.reaches(value):
            low, high = axis.ends
            past, end = ("below", low) if value < low else ("above", high)
            return f"{axis.name} {axis.shown(value)} is {past} {axis.shown(end)}"
    return ""


def surrounding(values: Mapping[str, Value | None], axes: Sequence[MapAxis], points: Sequence[Point]) -> list[Point]:
    """The points of a map around some values: those between the next values below and above on each axis.

    Where a point near a border has brought a value for which not all corners were tried, it is between the levels at
    which the map started. An axis without a value counts in full. There are none where the map has no such corners.
    """
    tried = [{point[number] for point in points} for number in range(len(axes))]
    own_points = set(points)
    for steps in (tried, [set(axis.values) for axis in axes]):
        sides = [_next_to(axis, values[axis.name], own) for axis, own in zip(axes, steps, strict=True)]
        if all(sides) and all(corner in own_points for corner in product(*sides)):
            return [point for point in points if all(map(_within, axes, point, sides))]
    return []


def _next_to(axis: MapAxis, value: Value | None, steps: Iterable[Value]) -> list[Value]:
    """Of some values of an axis the nearest on both sides of one, or that itself; all where there is none."""
    ordered = sorted(steps, key=axis.share)
    if value is None or value in ordered:
        return ordered if value is None else [value]
    if not axis.reaches(value):
        return []
    share = axis.share(value)
    above = next(place for place, step in enumerate(ordered) if axis.share(step) > share)
    return ordered[above - 1 : above + 1]


def _within(axis: MapAxis, value: Value, sides: Sequence[Value]) -> bool:
    return axis.share(sides[0]) <= axis.share(value) <= axis.share(sides[-1])
