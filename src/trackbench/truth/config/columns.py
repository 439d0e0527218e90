"""Options of a recording's tables: their columns, and which parts of the truth are scored."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np
from pydantic import ConfigDict, Field

from trackbench.base.config import Config, Positive, Problem
from trackbench.truth.config.logs import Paths

#: Units that columns may have, with their size in SI units and radians; the first is that of a column without a unit.
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
    **dict.fromkeys(("px", "py"), "length"),
    **dict.fromkeys(("length", "width"), "size"),
    **dict.fromkeys(("vx", "vy", "speed"), "speed"),
    **dict.fromkeys(("yaw", "course", "heading", "yaw_rate"), "angle"),
}
COMPONENT_QUANTITIES = {"m": "length", "m/s": "speed", "rad": "angle"}
#: The two ways to state a position in a sensor's frame.
POLAR, CARTESIAN = ("range", "azimuth"), ("x", "y")
#: The ways to state a velocity; without columns it is computed from the displacement.
VELOCITY = ((), ("vx", "vy"), ("speed", "course"))


class Column(NamedTuple):
    """Column of a table file: its name, and how its cells are converted to SI units."""

    name: str
    quantity: str | None = None
    """Quantity, such as length or angle; None for cells that are read as they are."""
    unit: str = ""
    """Unit of the cells; empty without a quantity."""
    factor: float = 1.0
    """Factor from the unit of the cells to SI units and radians."""


def column_in(name: str, quantity: str | None, unit: str = "") -> Column:
    """Return the column with this name and unit; SI or radians if ``unit`` is not a unit of ``quantity``."""
    units = UNITS.get(quantity or "", {})
    unit = unit if unit in units else next(iter(units), "")
    return Column(name, quantity, unit, units.get(unit, 1.0))


def stated_column(text: str, quantity: str | None) -> Column:
    """Return the column that a scenario states by its name, or by its name and unit, as in ``phi:deg``."""
    name, _, unit = text.rpartition(":")
    return column_in(name, quantity, unit) if unit in UNITS.get(quantity or "", {}) else column_in(text, quantity)


class MotionColumns(Config):
    """Columns with position and velocity, which truth and observer share."""

    px: str = Field(description="Position along x in the fixed frame.")
    py: str = Field(description="Position along y in the fixed frame.")
    vx: str | None = Field(None, description="Velocity along x in the fixed frame.")
    vy: str | None = Field(None, description="Velocity along y in the fixed frame.")
    speed: str | None = Field(None, description="Speed along the course.")
    course: str | None = Field(None, description="Direction of motion, counter-clockwise from x.")

    @property
    def stated(self) -> dict[str, Column]:
        """Columns that the scenario states, by key, except the column of the time."""
        return {
            key: stated_column(value, quantity)
            for key, value in self
            if (quantity := MOTION_QUANTITIES.get(key)) is not None and value is not None
        }

    @property
    def without_velocity(self) -> bool:
        """Whether the columns have positions but no velocity."""
        return self.vx is None and self.speed is None

    def problems(self) -> Iterator[Problem]:
        keys = ("vx", "vy", "speed", "course")
        if tuple(key for key in keys if getattr(self, key) is not None) not in VELOCITY:
            yield Problem((), "a velocity is either vx and vy, or speed and course")


class ObserverColumns(MotionColumns):
    """Columns with the motion of the observer, which carries the sensors.

    Position, heading (the short way round) and velocity are interpolated linearly between rows. Without columns of the
    velocity it is computed from the displacement.
    """

    path: Paths = Field(description="The file, of the same format.")
    time: str | None = Field(None, description="Time; named as in truth.columns unless given.")
    yaw: str = Field(description="Heading, counter-clockwise from x.")
    yaw_rate: str | None = Field(None, description="Rate of change of the heading; from the heading unless given.")


class TruthColumns(MotionColumns):
    """Columns with the true motion.

    A unit may stand after the name of a column and a colon, as in `v:kmph`: s, ms, us, ns; m, km, cm, mm, ft;
    mps, kmph, mph; rad, deg. Without a unit a column is in SI units and radians.

    With hidden identities the velocity may be left out; it is then computed from the displacement.
    """

    time: str = Field(description="Time; the truth starts at 0 s.")
    object: str | None = Field(None, description="Name of the object; all rows are of one object unless given.")
    heading: str | None = Field(
        None, description="Heading of the body, counter-clockwise from x; the direction of motion unless given."
    )
    length: str | None = Field(None, description="Length of the object's box; truth.length_m unless given.")
    width: str | None = Field(None, description="Width of the object's box; truth.width_m unless given.")
    kind: str | None = Field(None, alias="class", description="Class of the object, for truth.reference.classes.")


class MeasurementColumns(Config):
    """Columns with a sensor's measurements; where they are empty, the object was not detected.

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
    time_offset_s: float = Field(
        0, ge=-3600, le=3600, description="Added to the times, s; negative where the time stamps are late."
    )
    bias: dict[str, float] = Field(
        default_factory=dict,
        description="Known constant errors by component, in the unit of its column, to be subtracted: `{range: 0.5}`.",
    )

    @property
    def components(self) -> dict[str, str]:
        """Column in the file of each component of the measurement, by component, as the scenario states it."""
        return dict(self.__pydantic_extra__)

    def of_sensor(self, components: tuple[str, ...]) -> tuple[str, ...]:
        """Return the components that the file has: the sensor's, or x and y for a radar's range and azimuth."""
        cartesian = components[:2] == POLAR and any(name in self.components for name in CARTESIAN)
        return (*CARTESIAN, *components[2:]) if cartesian else components

    def columns(self, components: tuple[str, ...], units: tuple[str, ...]) -> dict[str, Column]:
        """Return the column of each component in the file, for a sensor with these components and their units."""
        names = self.of_sensor(components)
        component_units = units if names == components else ("m", "m", *units[2:])
        return {
            name: stated_column(self.components[name], COMPONENT_QUANTITIES.get(unit))
            for name, unit in zip(names, component_units, strict=True)
            if name in self.components
        }

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
