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
    """Moving points that a sensor measures on the objects, and the objects' boxes, at the instants of the scans.

    The last axis of each array is the runs, or has length 1 where the motion is the same in all runs.
    """

    target: Array
    """Measured points ``(4, instants, objects, runs or 1)``: x, y, vx, vy in the fixed frame; at first the centres."""
    heading: Array
    """Heading of each box ``(instants, objects, runs or 1)``, rad, counter-clockwise from the fixed x axis."""
    axis: Array
    """Cosine and sine ``(2, instants, objects, runs or 1)`` of the heading."""
    yaw_rate: Array
    """Rate of change of the heading ``(instants, objects, runs or 1)``, rad/s."""
    length: Array
    """Length of each box ``(objects, 1)``, m."""
    width: Array
    """Width of each box ``(objects, 1)``, m."""
    centre: Array
    """Centres of the boxes ``(2, instants, objects, runs or 1)``: x, y in the fixed frame, m; no effect moves them."""

    def of_runs(self, runs: range) -> Bodies:
        """Return the objects' points and boxes in the given runs."""
        moving = {name: of_runs(getattr(self, name), runs) for name in MOVING}
        return replace(self, **moving)

    def seen_from(self, pose: Array) -> Array:
        """Return the sensor's offset ``(2, instants, objects, runs or 1)`` ahead and left of each box's centre, m.

        The sensor's pose is ``(3, instants, runs or 1)``.
        """
        dx, dy = pose[0][:, None] - self.centre[0], pose[1][:, None] - self.centre[1]
        c, s = self.axis
        return np.stack([c * dx + s * dy, c * dy - s * dx])

    def moved(self, ahead: Array, left: Array) -> Bodies:
        """Move the measured points ahead and left on the boxes, m, and add the velocity that a turn gives them."""
        c, s = self.axis
        target = np.zeros((4, *np.broadcast_shapes(self.target.shape[1:], ahead.shape))).view(type(self.target))
        x, y = np.subtract(c * ahead, s * left, out=target[0]), np.add(s * ahead, c * left, out=target[1])
        np.multiply(y, -self.yaw_rate, out=target[2])
        np.multiply(x, self.yaw_rate, out=target[3])
        target += self.target
        return replace(self, target=target)


@dataclass(frozen=True)
class Sensed:
    """Scans of one sensor in several runs, with all that determines its measurements, before white noise is added.

    The last axis of each array but ``time`` is the runs, or has length 1 where all runs are alike.
    """

    sensor: SensorModel
    runs: int
    time: Array
    """Times of the scans ``(instants,)``, s."""
    pose: Array
    """Pose of the sensor ``(3, instants, runs or 1)``: x m, y m, yaw rad in the fixed frame."""
    velocity: Array
    """Velocity of the sensor ``(2, instants, runs or 1)``: vx, vy in the fixed frame, m/s."""
    yaw_rate: Array
    """Yaw rate of the sensor ``(instants, runs or 1)``, rad/s."""
    bodies: Bodies
    """Measured points on the objects, and the objects' boxes."""
    visible: Mask
    """Mask ``(instants, objects, runs or 1)``, True where an object is in the field of view and not hidden."""
    probability: Array
    """Detection probability P_D ``(instants, objects, runs or 1)`` of an object if it is visible."""
    scale: Array
    """Factor ``(m or 1, instants, objects, runs or 1)`` on the standard deviation of the white noise."""
    slow_scale: Array
    """Factor ``(m or 1, instants, objects, runs or 1)`` on the standard deviation of slowly changing errors. It leaves
    out all that changes from scan to scan, such as the received power."""
    error: Array
    """Error ``(m, instants, objects, runs)`` in addition to the white noise, in SI units and radians."""

    @property
    def shape(self) -> tuple[int, int]:
        """Number of instants and number of objects: the shape of one draw per measurement of a run."""
        instants, objects = self.error.shape[1:3]
        return instants, objects

    def replaced(self, **values: Any) -> Sensed:
        """Return a copy with the named fields replaced by ``values``."""
        return replace(self, **values)

    def ideal(self) -> Array:
        """Return the error-free measurements ``(m, instants, objects, runs or 1)`` of the measured points."""
        return np.asarray(self.sensor.measure(self.bodies.target, self.pose[:, :, None], self.velocity[:, :, None]))

    def sigmas(self) -> Array:
        """Return the noise's standard deviations ``(m, 1, 1, 1)`` in the sensor's options, in SI units and radians."""
        return np.array(self.sensor.sigmas())[:, None, None, None]


class Effect(Config, ABC):
    """Difference of a real sensor from an ideal one. The fields of a subclass are its options in a scenario.

    Effects act in the order in which a sensor lists them. Each draws from its own random stream.
    """

    one_of: ClassVar[tuple[str, ...]] = ()
    """Options, at least one required in a scenario: if none of them is set, the effect does nothing."""

    type: str = Field("", description="Name of the effect.")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, data: Any) -> Any:
        return {"type": EFFECTS.name_of(cls), **data} if isinstance(data, dict) else data

    def problems(self) -> Iterator[Problem]:
        if self.one_of and not self.model_fields_set & {*self.one_of}:
            yield Problem(("type",), f"{self.type} does nothing without one of these: {', '.join(self.one_of)}")

    def problems_on(self, sensor: SensorModel) -> Iterator[Problem]:
        """Yield the problems of the effect's options on a given sensor."""
        yield from ()

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        """Return the scans changed by the effect, before the white noise is added."""
        return sensed

    def after(self, measurement: Array, sensor: SensorModel) -> Array:
        """Return the measurements ``(m, ...)`` changed by the effect, given measurements with all noise."""
        return measurement

    def alarms(self, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array] | None:
        """Return additional false alarms, used with hidden identities alone; None if there are none.

        The tuple holds the indices ``(n,)`` of their runs within ``sensed``, the indices ``(n,)`` of their instants,
        and their measurements ``(m, n)`` without white noise.
        """
        return None

    @classmethod
    def has(cls, method: str) -> bool:
        """Return whether the class of the effect overrides ``method``."""
        return getattr(cls, method) is not getattr(Effect, method)


def _lacks(plugin: Any) -> str | None:
    lacking = lacks_class(Effect)(plugin)
    if lacking is None and not any(map(plugin.has, ("before", "after", "alarms"))):
        return "it has no method before, after or alarms"
    return lacking


#: Effects by the names that scenarios use.
EFFECTS: Registry[type[Effect]] = Registry("trackbench.sensor_effects", "sensor effect", _lacks)


def by_component(sizes: Mapping[str, float], sensor: SensorModel) -> Array:
    """Return sizes ``(m,)`` in SI units and radians from keys such as ``azimuth_deg``; 0 for other components."""
    stated = {split_key(key)[0]: in_si(key, value) for key, value in sizes.items()}
    return np.array([stated.get(name, 0.0) for name in sensor.components])


def component_problems(
    key: str, sizes: Mapping[str, float], sensor: SensorModel | type[SensorModel]
) -> Iterator[Problem]:
    """Yield a problem for each key of ``sizes`` that is not a component of the sensor plus a unit of its quantity."""
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
