"""Options of a recording's tables: names and units of columns, and which parts of the truth are scored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

import numpy as np
from pydantic import ConfigDict, Field

from trackbench.base.config import Config, Positive, Problem
from trackbench.base.errors import nearest_choices
from trackbench.truth.config.logs import Paths

#: Units that columns may have, with their size in SI units and radians.
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048},
    "speed": {"mps": 1.0, "kmph": 1 / 3.6, "mph": 0.44704},
    "angle": {"rad": 1.0, "deg": np.pi / 180},
    "probability": {},
}
UNITS["size"] = UNITS["length"]
#: Quantity in each column of a motion, and quantity of a measurement's component by its unit.
MOTION_QUANTITIES = {
    "time": "time",
    **dict.fromkeys(("px", "py"), "length"),
    **dict.fromkeys(("length", "width"), "size"),
    **dict.fromkeys(("vx", "vy"), "speed"),
    **dict.fromkeys(("yaw", "heading", "yaw_rate"), "angle"),
}
COMPONENT_QUANTITIES = {"m": "length", "m/s": "speed", "rad": "angle"}
#: The two ways to state a position in a sensor's frame.
POLAR, CARTESIAN = ("range", "azimuth"), ("x", "y")
_OWN_UNITS = "Units of single columns, by the keys above: `{time: us, %s: deg}`; those of truth.units unless given."


class Units(Config):
    """Units of all columns without a unit of their own."""

    time: Literal["s", "ms", "us", "ns"] = Field("s", description="Unit of times; the truth starts at 0 s.")
    length: Literal["m", "km", "cm", "mm", "ft"] = Field("m", description="Unit of positions and ranges.")
    speed: Literal["mps", "kmph", "mph"] = Field("mps", description="Unit of velocities and range rates.")
    angle: Literal["rad", "deg"] = Field("rad", description="Unit of angles, and per second of turn rates.")

    def factor(self, quantity: str | None, own_unit: str | None) -> float:
        """Return the factor to SI units from a column's own unit, or from the unit of all columns of the quantity."""
        units = {**dict(self), "size": self.length}
        return 1.0 if quantity not in units else UNITS[quantity][own_unit or units[quantity]]


def unit_problems(units: Mapping[str, str], quantities: Mapping[str, str | None]) -> Iterator[Problem]:
    """Yield what is wrong with the units of single columns.

    Args:
        units: unit by key of the column, such as ``{"yaw": "deg"}``.
        quantities: quantity (length, angle and so on) of each given column, by key; None if it has no unit.
    """
    for key, unit in units.items():
        quantity = quantities.get(key)
        if key not in quantities:
            yield Problem(("units", key), f"no column is given for {key!r}; {nearest_choices(key, quantities)}")
        elif quantity is None:
            yield Problem(("units", key), f"{key} is read as it is; remove")
        elif unit not in UNITS[quantity]:
            yield Problem(
                ("units", key), f"{unit!r} is no unit of {quantity}; {nearest_choices(unit, UNITS[quantity])}"
            )


class MotionColumns(Config):
    """Names of the columns with position and velocity, which truth and observer share."""

    px: str = Field(description="Position along x in the fixed frame.")
    py: str = Field(description="Position along y in the fixed frame.")
    vx: str | None = Field(None, description="Velocity along x in the fixed frame.")
    vy: str | None = Field(None, description="Velocity along y in the fixed frame.")

    @property
    def stated(self) -> dict[str, str]:
        """Names of the given columns, by key."""
        return {key: value for key, value in self if key in MOTION_QUANTITIES and value is not None}

    @property
    def without_velocity(self) -> bool:
        """Whether the columns have positions but no velocity."""
        return self.vx is None

    def problems(self) -> Iterator[Problem]:
        if (self.vx is None) != (self.vy is None):
            yield Problem((), "a velocity is vx and vy: write both or none")


class ObserverColumns(MotionColumns):
    """Columns with the motion of the observer, which carries the sensors.

    Position, heading (the short way round) and velocity are interpolated linearly between rows. Without columns of the
    velocity it is computed from the displacement.
    """

    path: Paths = Field(description="The file, of the same format.")
    time: str | None = Field(None, description="Time; named as in truth.columns unless given.")
    yaw: str = Field(description="Heading, counter-clockwise from x.")
    yaw_rate: str | None = Field(None, description="Rate of change of the heading; from the heading unless given.")
    units: dict[str, str] = Field(default_factory=dict, description=_OWN_UNITS % "yaw")

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        yield from unit_problems(self.units, {key: MOTION_QUANTITIES[key] for key in ("time", *self.stated)})


class TruthColumns(MotionColumns):
    """Names of the columns with the true motion.

    With hidden identities the velocity may be left out; it is then computed from the displacement.
    """

    time: str = Field(description="Time.")
    object: str | None = Field(None, description="Name of the object; all rows are of one object unless given.")
    heading: str | None = Field(
        None, description="Heading of the body, counter-clockwise from x; the direction of motion unless given."
    )
    length: str | None = Field(None, description="Length of the object's box; truth.length_m unless given.")
    width: str | None = Field(None, description="Width of the object's box; truth.width_m unless given.")
    kind: str | None = Field(None, alias="class", description="Class of the object, for truth.reference.classes.")
    units: dict[str, str] = Field(default_factory=dict, description=_OWN_UNITS % "heading")

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        yield from unit_problems(self.units, {key: MOTION_QUANTITIES[key] for key in self.stated})


class MeasurementColumns(Config):
    """Names of the columns with a sensor's measurements; where they are empty, the object was not detected.

    Beside the keys below there is a key for each component of the sensor's measurement: range, azimuth and range_rate
    for a radar, x and y for a lidar (`trackbench list sensors` shows them). A radar whose file has positions has x
    (forward) and y (left), in the sensor's frame, instead of range and azimuth.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, str] = Field(init=False)

    path: Paths | None = Field(None, description="The file, of the same format; the truth's file unless given.")
    time: str | None = Field(None, description="Time of the measurement; named as in truth.columns unless given.")
    object: str | None = Field(
        None,
        description="Name of the object; named as in truth.columns unless given. Where it is empty, the detection is "
        "of no object. With hidden identities and a file of its own, detections are unlabelled unless it is given.",
    )
    slot: str | None = Field(
        None,
        description="For unlabelled detections: the sensor's own number of a track, which trackers are not told. It "
        "shows which rows belong to one cycle, even some ms apart; without it, the rows of one time are a scan.",
    )
    new_track: str | None = Field(
        None, description="For unlabelled detections: 1 where the slot took a new object, else 0."
    )
    copies_within_m: Positive | None = Field(
        None,
        description="For unlabelled detections: distance, m, below which only the detection of the older slot is kept "
        "of two in one cycle: some radars list an object twice. All are kept unless given.",
    )
    units: dict[str, str] = Field(default_factory=dict, description=_OWN_UNITS % "azimuth")
    time_offset_s: float = Field(
        0, ge=-3600, le=3600, description="Added to the times, s; negative where the time stamps are late."
    )
    bias: dict[str, float] = Field(
        default_factory=dict,
        description="Known constant errors by component, in the unit of its column, to be subtracted: `{range: 0.5}`.",
    )

    @property
    def components(self) -> dict[str, str]:
        """Name of the column of each given component of the measurement, by component."""
        return dict(self.__pydantic_extra__)

    def of_sensor(self, components: tuple[str, ...]) -> tuple[str, ...]:
        """Return the components that the file has: the sensor's, or x and y for a radar's range and azimuth."""
        cartesian = components[:2] == POLAR and any(name in self.components for name in CARTESIAN)
        return (*CARTESIAN, *components[2:]) if cartesian else components

    def quantities(self, components: tuple[str, ...], units: tuple[str, ...]) -> dict[str, str | None]:
        """Return the quantity (length, angle and so on) of each component in the file; None if it is not converted."""
        names = self.of_sensor(components)
        component_units = units if names == components else ("m", "m", *units[2:])
        return {name: COMPONENT_QUANTITIES.get(unit) for name, unit in zip(names, component_units, strict=True)}

    def problems(self) -> Iterator[Problem]:
        if self.new_track is not None and self.slot is None:
            yield Problem(("new_track",), "is of a slot, whose column is not given; add slot")


class ReferenceOptions(Config):
    """Options that say which parts of a recorded truth are scored.

    Objects out of range or of another class, and tracks on them, do not change any score. The same holds on the
    don't-care boxes of KITTI and MOTChallenge.
    """

    range_m: Positive | None = Field(
        None, description="Distance from the observer up to which objects count, m; without limit unless given."
    )
    classes: list[str] | None = Field(
        None,
        min_length=1,
        description="Classes that count, as they stand in columns.class or in the format, whatever their case; all "
        "unless given. Objects of other classes still hide what is behind them.",
    )
    others: Literal["ignored"] | None = Field(
        None,
        description="ignored: tracks on no object do not count, as where only one car of many is in the truth. Missed "
        "objects, positions and switches are scored; metrics of false tracks are n/a. Default: they are false tracks.",
    )

    @property
    def of_tracks(self) -> list[str]:
        """Names of the given options that restrict what is scored."""
        return [key for key in ("range_m", "classes", "others") if getattr(self, key)]
