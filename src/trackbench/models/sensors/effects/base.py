"""Base class of the effects of real sensors, and the arrays that effects change."""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from trackbench.base.config import Config, Problem
from trackbench.base.config.key_units import find_unit, in_si, split_key
from trackbench.base.errors import nearest_choices
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array, Indices, Mask, of_runs
from trackbench.models.sensors.model import SensorModel

#: Arrays of ``Bodies`` that may differ from run to run.
MOVING = ("target", "heading", "axis", "yaw_rate", "centre")


@dataclass(frozen=True)
class Bodies:
    """Moving points that a sensor measures, and the boxes of their bodies, at the instants of the scans.

    The last axis of each array is the runs, or has length 1 where the motion is the same in all runs.
    """

    target: Array
    """``(4, instants, objects, runs or 1)`` x, y, vx, vy of the points in the fixed frame; the centres at first."""
    heading: Array
    """``(instants, objects, runs or 1)`` rad."""
    axis: Array
    """``(2, instants, objects, runs or 1)`` cosine and sine of the heading."""
    yaw_rate: Array
    """``(instants, objects, runs or 1)`` rad/s."""
    length: Array
    """``(objects, 1)`` m."""
    width: Array
    """``(objects, 1)`` m."""
    centre: Array
    """``(2, instants, objects, runs or 1)`` x, y of the centres of the boxes, which no effect moves."""

    def of_runs(self, runs: range) -> Bodies:
        """Return the bodies in some runs."""
        moving = {name: of_runs(getattr(self, name), runs) for name in MOVING}
        return replace(self, **moving)

    def seen_from(self, pose: Array) -> Array:
        """Return ``(2, instants, objects, runs or 1)``: a sensor's position ahead and to the left of each centre, m.

        The sensor's pose is ``(3, instants, runs or 1)``.
        """
        dx, dy = pose[0][:, None] - self.centre[0], pose[1][:, None] - self.centre[1]
        c, s = self.axis
        return np.stack([c * dx + s * dy, c * dy - s * dx])

    def moved(self, ahead: Array, left: Array) -> Bodies:
        """Move the points ahead and to the left on the bodies, m, and add the velocity that a turn gives them."""
        c, s = self.axis
        target = np.zeros((4, *np.broadcast_shapes(self.target.shape[1:], ahead.shape))).view(type(self.target))
        x, y = np.subtract(c * ahead, s * left, out=target[0]), np.add(s * ahead, c * left, out=target[1])
        np.multiply(y, -self.yaw_rate, out=target[2])
        np.multiply(x, self.yaw_rate, out=target[3])
        target += self.target
        return replace(self, target=target)


@dataclass(frozen=True)
class Sensed:
    """Scans of one sensor in several runs, before white noise is added.

    The last axis of each array but ``time`` is the runs, or has length 1 where all runs are alike.
    """

    sensor: SensorModel
    runs: int
    time: Array
    """``(instants,)`` s."""
    pose: Array
    """``(3, instants, runs or 1)`` x m, y m, yaw rad of the sensor."""
    velocity: Array
    """``(2, instants, runs or 1)`` vx, vy of the sensor, m/s."""
    yaw_rate: Array
    """``(instants, runs or 1)`` yaw rate of the sensor, rad/s."""
    bodies: Bodies
    """Measured points and their bodies."""
    visible: Mask
    """``(instants, objects, runs or 1)`` True where an object is in view."""
    probability: Array
    """``(instants, objects, runs or 1)`` P_D of a visible object."""
    scale: Array
    """``(m or 1, instants, objects, runs or 1)`` factor on the white noise's standard deviation of the options."""
    slow_scale: Array
    """``(m or 1, instants, objects, runs or 1)`` factor on the standard deviation of slow errors. It leaves out all
    that changes from scan to scan, such as the received power."""
    error: Array
    """``(m, instants, objects, runs)`` error in addition to the white noise, in SI units and radians."""

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of instants and objects, the shape of a draw for each measurement of a run."""
        instants, objects = self.error.shape[1:3]
        return instants, objects

    def replaced(self, **values: Any) -> Sensed:
        """Return a copy with some fields replaced."""
        return replace(self, **values)

    def ideal(self) -> Array:
        """Return the error-free measurements ``(m, instants, objects, runs or 1)`` of the points."""
        return np.asarray(self.sensor.measure(self.bodies.target, self.pose[:, :, None], self.velocity[:, :, None]))

    def sigmas(self) -> Array:
        """Return the standard deviations ``(m, 1, 1, 1)`` of the sensor's options, in SI units and radians."""
        return np.array(self.sensor.sigmas())[:, None, None, None]


class Effect(Config, ABC):
    """Difference of a real sensor from an ideal one. The fields of a subclass are its options in a scenario.

    Effects act in the order in which a sensor lists them. Each draws from its own random stream.
    """

    one_of: ClassVar[tuple[str, ...]] = ()
    """Options, at least one of them required: the effect does nothing without."""

    type: str = Field("", description="Name of the effect.")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, data: Any) -> Any:
        return {"type": EFFECTS.name_of(cls), **data} if isinstance(data, dict) else data

    def problems(self) -> Iterator[Problem]:
        if self.one_of and not self.model_fields_set & {*self.one_of}:
            yield Problem(("type",), f"{self.type} does nothing without one of these: {', '.join(self.one_of)}")

    def problems_on(self, sensor: SensorModel) -> Iterator[Problem]:
        """Yield the problems of the options on this sensor."""
        yield from ()

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        """Return the scans as they are before the white noise is added."""
        return sensed

    def after(self, measurement: Array, sensor: SensorModel) -> Array:
        """Return the measurements ``(m, ...)`` as the sensor gives them, from measurements with all noise."""
        return measurement

    def alarms(self, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array] | None:
        """Return further false alarms, which matter with hidden identities alone; None without any.

        Run numbers ``(n,)`` from 0 within ``sensed``, instant numbers ``(n,)`` and measurements ``(m, n)`` without
        white noise.
        """
        return None

    @classmethod
    def has(cls, method: str) -> bool:
        """Return whether the class overrides a method."""
        return getattr(cls, method) is not getattr(Effect, method)


def _lacks(plugin: Any) -> str | None:
    lacking = lacks_class(Effect)(plugin)
    if lacking is None and not any(map(plugin.has, ("before", "after", "alarms"))):
        return "it has no method before, after or alarms"
    return lacking


#: Effects by the names that scenarios use.
EFFECTS: Registry[type[Effect]] = Registry("trackbench.sensor_effects", "sensor effect", _lacks)


def by_component(sizes: Mapping[str, float], sensor: SensorModel) -> Array:
    """Return sizes ``(m,)`` in SI units and radians from keys such as ``azimuth_deg``; 0 where none is stated."""
    stated = {split_key(key)[0]: in_si(key, value) for key, value in sizes.items()}
    return np.array([stated.get(name, 0.0) for name in sensor.components])


def component_problems(
    key: str, sizes: Mapping[str, float], sensor: SensorModel | type[SensorModel]
) -> Iterator[Problem]:
    """Yield the keys that do not consist of a component of the sensor and a unit of its quantity."""
    units = dict(zip(sensor.components, map(find_unit, sensor.units), strict=True))
    usual = {"length": "m", "angle": "deg", "speed": "mps"}
    names = [f"{name}_{usual[unit.quantity]}" for name, unit in units.items() if unit]
    first: dict[str, str] = {}
    for name in sizes:
        component, unit = split_key(name)
        measured = units.get(component)
        if unit is None or measured is None or measured.quantity != unit.quantity:
            yield Problem(
                (key, name), f"is no component of a {sensor.kind()} with its unit; {nearest_choices(name, names)}"
            )
        elif first.setdefault(component, name) != name:
            yield Problem((key, name), f"the {component} is stated by {first[component]} already; remove one of them")
