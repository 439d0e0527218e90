"""The options of a recording's rows: names and units of their columns, and which of them count where."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

import numpy as np
from pydantic import ConfigDict, Field

from trackbench.base.config import Config, Positive, Problem
from trackbench.base.errors import nearest_choices
from trackbench.truth.config.logs import Paths

#: The units that columns may have, in SI units and radians.
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048},
    "speed": {"mps": 1.0, "kmph": 1 / 3.6, "mph": 0.44704},
    "angle": {"rad": 1.0, "deg": np.pi / 180},
    "probability": {},
}
UNITS["size"] = UNITS["length"]
#: The quantity in each column of a motion; that of a measurement's component follows from its unit.
MOTION_QUANTITIES = {
    "time": "time",
    **dict.fromkeys(("px", "py"), "length"),
    **dict.fromkeys(("length", "width"), "size"),
    **dict.fromkeys(("vx", "vy", "speed"), "speed"),
    **dict.fromkeys(("yaw", "course", "heading", "yaw_rate"), "angle"),
}
COMPONENT_QUANTITIES = {"m": "length", "m/s": "speed", "rad": "angle"}
#: The two ways to state a position in a sensor's frame.
POLAR, CARTESIAN = ("range", "azimuth"), ("x", "y")
#: The two ways to state a velocity.
VELOCITY = (("vx", "vy"), ("speed", "course"))
_OWN_UNITS = "Units of single columns, by the keys above: `{time: us, %s: deg}`; those of truth.units unless given."


class Units(Config):
    """The units of all columns that state none of their own."""

    time: Literal["s", "ms", "us", "ns"] = Field("s", description="Of times; the truth's first instant becomes 0 s.")
    length: Literal["m", "km", "cm", "mm", "ft"] = Field("m", description="Of positions and ranges.")
    speed: Literal["mps", "kmph", "mph"] = Field("mps", description="Of velocities and range rates.")
    angle: Literal["rad", "deg"] = Field("rad", description="Of angles, and per second of turn rates.")

    def factor(self, quantity: str | None, own: str | None) -> float:
        """What a column is multiplied by; ``own`` is the unit that it states itself."""
        stated = {**dict(self), "size": self.length}
        return 1.0 if quantity not in stated else UNITS[quantity][own or stated[quantity]]


def unit_problems(units: Mapping[str, str], quantities: Mapping[str, str | None]) -> Iterator[Problem]:
    """What is wrong with the units of single columns.

    Args:
        units: by the columns' keys.
        quantities: of all columns that are given, by key.
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
    """What the columns of the truth and of the observer have in common."""

    px: str = Field(description="Position along x in the fixed frame.")
    py: str = Field(description="Position along y in the fixed frame.")
    vx: str | None = Field(None, description="Velocity along x in the fixed frame.")
    vy: str | None = Field(None, description="Velocity along y in the fixed frame.")
    speed: str | None = Field(None, description="Speed along the course.")
    course: str | None = Field(None, description="Direction of motion, counter-clockwise from x.")

    @property
    def stated(self) -> dict[str, str]:
        """The columns that are given, by key."""
        return {key: value for key, value in self if key in MOTION_QUANTITIES and value is not None}

    @property
    def without_velocity(self) -> bool:
        """Whether there are positions alone."""
        return all(getattr(self, key) is None for pair in VELOCITY for key in pair)

    def velocity_problems(self) -> Iterator[Problem]:
        """What is wrong with how the velocity is given."""
        pairs = [pair for pair in VELOCITY if any(getattr(self, key) is not None for key in pair)]
        if len(pairs) > 1:
            yield Problem((), "the velocity is given twice: write vx and vy, or speed and course")
            return
        for key in [key for pair in pairs for key in pair if getattr(self, key) is None]:
            yield Problem((key,), f"missing: a velocity is {' and '.join(pairs[0])}")


class ObserverColumns(MotionColumns):
    """Columns with the motion of what carries the sensors.

    Between its rows the position, the heading (the short way round) and the velocity are interpolated linearly. Without
    columns of the velocity it is that of the displacement.
    """

    path: Paths = Field(description="The file, of the same format.")
    time: str | None = Field(None, description="Time; named as in truth.columns unless given.")
    yaw: str = Field(description="Heading, counter-clockwise from x.")
    yaw_rate: str | None = Field(None, description="Rate of change of the heading; from the heading unless given.")
    units: dict[str, str] = Field(default_factory=dict, description=_OWN_UNITS % "yaw")

    def problems(self) -> Iterator[Problem]:
        yield from self.velocity_problems()
        yield from unit_problems(self.units, {key: MOTION_QUANTITIES[key] for key in ("time", *self.stated)})


class TruthColumns(MotionColumns):
    """Names of the columns that hold the true motion. The velocity is vx and vy, or speed and course.

    With hidden identities it may be left out; then it is that of the displacement.
    """

    time: str = Field(description="Time.")
    object: str | None = Field(None, description="Name of the object; all rows are of one object unless given.")
    heading: str | None = Field(
        None, description="Direction in which the body points, counter-clockwise from x; the course unless given."
    )
    length: str | None = Field(None, description="Length of the object's box; truth.length_m unless given.")
    width: str | None = Field(None, description="Width of the object's box; truth.width_m unless given.")
    kind: str | None = Field(None, alias="class", description="Class of the object, for truth.reference.classes.")
    units: dict[str, str] = Field(default_factory=dict, description=_OWN_UNITS % "course")

    def problems(self) -> Iterator[Problem]:
        yield from self.velocity_problems()
        yield from unit_problems(self.units, {key: MOTION_QUANTITIES[key] for key in self.stated})


class MeasurementColumns(Config):
    """Names of the columns that hold a sensor's measurements; where they are empty, it did not detect the object.

    Beside the keys below there is one for each component of the sensor's measurement: range, azimuth and range_rate of
    a radar, x and y of a lidar (`trackbench list sensors` shows them). A radar whose file has positions has x (forward)
    and y (left), in its own frame, in place of range and azimuth.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, str] = Field(init=False)

    path: Paths | None = Field(None, description="The file, of the same format; that of the truth unless given.")
    time: str | None = Field(None, description="Time of the measurement; named as in truth.columns unless given.")
    object: str | None = Field(
        None,
        description="Name of the object; named as in truth.columns unless given. Where it is empty, the detection is "
        "of no object. With hidden identities and a file of its own, detections are unlabelled unless it is given.",
    )
    slot: str | None = Field(
        None,
        description="Of unlabelled detections: the sensor's own number of a track, which trackers are not told. By it "
        "the rows of one cycle are found, which may be some ms apart; without it, those of one time are a scan.",
    )
    new_track: str | None = Field(
        None, description="Of unlabelled detections: 1 where the slot took a new object, else 0."
    )
    copies_within_m: Positive | None = Field(
        None,
        description="Of unlabelled detections: of those of one cycle nearer to each other than this, m, the one of "
        "the older slot is kept: some radars list an object twice. All are kept unless given.",
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
        """The column of each component of a measurement that is given."""
        return dict(self.__pydantic_extra__)

    def of_sensor(self, components: tuple[str, ...]) -> tuple[str, ...]:
        """The components that the file has of a sensor's: of a radar, it may have a position as x and y."""
        cartesian = components[:2] == POLAR and any(name in self.components for name in CARTESIAN)
        return (*CARTESIAN, *components[2:]) if cartesian else components

    def quantities(self, components: tuple[str, ...], units: tuple[str, ...]) -> dict[str, str | None]:
        """The quantity in each of these columns, from the components of the sensor and their units; None: as it is."""
        names = self.of_sensor(components)
        own = units if names == components else ("m", "m", *units[2:])
        return {name: COMPONENT_QUANTITIES.get(unit) for name, unit in zip(names, own, strict=True)}

    def problems(self) -> Iterator[Problem]:
        if self.new_track is not None and self.slot is None:
            yield Problem(("new_track",), "is of a slot, whose column is not given; add slot")


class ReferenceOptions(Config):
    """What of a recorded truth counts.

    An object out of range or of another class need not be tracked, and a track there is not false: neither changes a
    score. The same holds on a don't-care box, which KITTI and MOTChallenge have.
    """

    range_m: Positive | None = Field(
        None, description="Distance from the observer up to which objects count, m; without limit unless given."
    )
    classes: list[str] | None = Field(
        None,
        min_length=1,
        description="Classes that count, as they stand in columns.class or in the format, whatever their case; all "
        "unless given. Objects of others hide what is behind them.",
    )
    others: Literal["ignored"] | None = Field(
        None,
        description="ignored: tracks on no object are nobody's business, as where one car of many has a reference. "
        "Missed objects, positions and switches are scored; what counts false tracks is n/a. False unless given.",
    )

    @property
    def of_tracks(self) -> list[str]:
        """The keys that are given of those that say what counts."""
        return [key for key in ("range_m", "classes", "others") if getattr(self, key)]
