"""What an effect of a sensor is."""

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
    """What a sensor sees at its instants: points that move, and the boxes around them.

    The last axis of each array is that of the runs; of length 1 where the motion is the same in all.
    """

    target: Array
    """``(4, instants, objects, runs or 1)`` x, y, vx, vy in the fixed frame, of the centre unless moved."""
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
        """Those of some runs."""
        moving = {name: of_runs(getattr(self, name), runs) for name in MOVING}
        return replace(self, **moving)

    def seen_from(self, pose: Array) -> Array:
        """Where a sensor of pose ``(3, instants, runs or 1)`` is, ahead and to the left of each centre, m.

        ``(2, instants, objects, runs or 1)``.
        """
        dx, dy = pose[0][:, None] - self.centre[0], pose[1][:, None] - self.centre[1]
        c, s = self.axis
        return np.stack([c * dx + s * dy, c * dy - s * dx])

    def moved(self, ahead: Array, left: Array) -> Bodies:
        """Points so far ahead of these and to the left on the bodies, m, with the velocity that a turn gives them."""
        c, s = self.axis
        target = np.zeros((4, *np.broadcast_shapes(self.target.shape[1:], ahead.shape))).view(type(self.target))
        x, y = np.subtract(c * ahead, s * left, out=target[0]), np.add(s * ahead, c * left, out=target[1])
        np.multiply(y, -self.yaw_rate, out=target[2])
        np.multiply(x, self.yaw_rate, out=target[3])
        target += self.target
        return replace(self, target=target)


@dataclass(frozen=True)
class Sensed:
    """Some runs of one sensor, before its white noise is added.

    The last axis of each array but ``time`` is that of the runs; it may have length 1 where all runs are alike.
    """

    sensor: SensorModel
    runs: int
    """How many."""
    time: Array
    """``(instants,)`` s."""
    pose: Array
    """``(3, instants, runs or 1)``."""
    velocity: Array
    """``(2, instants, runs or 1)``."""
    yaw_rate: Array
    """``(instants, runs or 1)`` rad/s."""
    bodies: Bodies
    """The points that are measured."""
    visible: Mask
    """``(instants, objects, runs or 1)``."""
    probability: Array
    """``(instants, objects, runs or 1)`` that an object that is visible is detected."""
    scale: Array
    """``(m or 1, instants, objects, runs or 1)`` the white noise's standard deviation over that of the options."""
    slow_scale: Array
    """``(m or 1, instants, objects, runs or 1)`` standard deviation of slow errors over that of the sensor's options.
    It has no part of one scan alone, such as the power that is received in it."""
    error: Array
    """``(m, instants, objects, runs)`` what is added beside the white noise, in SI units and radians."""

    @property
    def shape(self) -> tuple[int, int]:
        """Instants and objects: of what is drawn for each measurement of a run."""
        instants, objects = self.error.shape[1:3]
        return instants, objects

    def replaced(self, **values: Any) -> Sensed:
        """With other values of these fields."""
        return replace(self, **values)

    def ideal(self) -> Array:
        """``(m, instants, objects, runs or 1)`` what the sensor reads of the points without any error."""
        return np.asarray(self.sensor.measure(self.bodies.target, self.pose[:, :, None], self.velocity[:, :, None]))

    def sigmas(self) -> Array:
        """``(m, 1, 1, 1)`` standard deviations of the sensor's options, in SI units and radians."""
        return np.array(self.sensor.sigmas())[:, None, None, None]


class Effect(Config, ABC):
    """Something that a real sensor does. The fields of a subclass are its options in a scenario.

    Effects act in the order in which a sensor lists them. Each draws from a stream of its own.
    """

    one_of: ClassVar[tuple[str, ...]] = ()
    """Options of which one is to be stated at the least: without it does nothing."""

    type: str = Field("", description="The effect.")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, data: Any) -> Any:
        return {"type": EFFECTS.name_of(cls), **data} if isinstance(data, dict) else data

    def problems(self) -> Iterator[Problem]:
        if self.one_of and not self.model_fields_set & {*self.one_of}:
            yield Problem(("type",), f"{self.type} does nothing without one of these: {', '.join(self.one_of)}")

    def problems_on(self, sensor: SensorModel) -> Iterator[Problem]:
        """What is wrong with its options on this sensor."""
        yield from ()

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        """What is changed before the white noise is added."""
        return sensed

    def after(self, measurement: Array, sensor: SensorModel) -> Array:
        """Measurements ``(m, ...)`` as the sensor gives them."""
        return measurement

    def alarms(self, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array] | None:
        """Further detections, which belong to no object: numbers of their runs ``(n,)``, the first of ``sensed`` being
        0, and of their instants ``(n,)``, and measurements ``(m, n)`` without white noise. They matter with hidden
        identities alone."""
        return None

    @classmethod
    def has(cls, method: str) -> bool:
        """Whether it does something in one of these methods."""
        return getattr(cls, method) is not getattr(Effect, method)


def _lacks(plugin: Any) -> str | None:
    lacking = lacks_class(Effect)(plugin)
    if lacking is None and not any(map(plugin.has, ("before", "after", "alarms"))):
        return "it has none of before, after and alarms"
    return lacking


#: The effects by the names that scenarios use.
EFFECTS: Registry[type[Effect]] = Registry("trackbench.sensor_effects", "sensor effect", _lacks)


def by_component(sizes: Mapping[str, float], sensor: SensorModel) -> Array:
    """``(m,)`` sizes in SI units and radians from keys such as ``azimuth_deg``; 0 where none is stated."""
    stated = {split_key(key)[0]: in_si(key, value) for key, value in sizes.items()}
    return np.array([stated.get(name, 0.0) for name in sensor.components])


def component_problems(
    key: str, sizes: Mapping[str, float], sensor: SensorModel | type[SensorModel]
) -> Iterator[Problem]:
    """Keys that are no component of the sensor with a unit of its quantity."""
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
