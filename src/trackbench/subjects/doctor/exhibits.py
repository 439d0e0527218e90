"""What a finding shows, as data for a figure: the wrong numbers beside the right ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from trackbench.base.types import COMMON_STATE, Array
from trackbench.models.sensors import SENSOR_MODELS

#: Names of the state's components with their units.
STATE = tuple(f"{name}, {'m' if name.startswith('p') else 'm/s'}" for name in COMMON_STATE)


def components_of(kind: str) -> tuple[str, ...]:
    """The names of the components of a kind of sensor with their units."""
    model = SENSOR_MODELS[kind]
    return tuple(f"{name.replace('_', ' ')}, {unit}" for name, unit in zip(model.components, model.units, strict=True))


class Exhibit:
    """What a finding shows."""


class Panel(NamedTuple):
    """A matrix."""

    title: str
    values: Array
    """``(rows, columns)``, NaN where unknown."""
    role: Literal["tracker", "before", "right"] = "tracker"
    """What it is: the wrong one, what that was made from, or the right one."""


@dataclass(frozen=True, eq=False)
class Matrices(Exhibit):
    """Matrices with the same rows and columns."""

    title: str
    rows: tuple[str, ...]
    """With units."""
    columns: tuple[str, ...]
    """With units."""
    panels: tuple[Panel, ...]
    marked: tuple[tuple[int, int], ...]
    """The entries that the finding names."""


class StatedBelief(NamedTuple):
    """An estimate with what it is called; NaN where a component is unknown."""

    name: str
    mean: Array
    """``(4,)`` px, py in m, vx, vy in m/s."""
    covariance: Array
    """``(4, 4)``"""


@dataclass(frozen=True, eq=False)
class Predictions(Exhibit):
    """The estimate after a step as the tracker has it, the right one, and the one before the step."""

    title: str
    before: StatedBelief | None
    tracker: StatedBelief
    right: StatedBelief


@dataclass(frozen=True, eq=False)
class Covariances(Exhibit):
    """Covariances of one state, around the same point."""

    title: str
    before: StatedBelief
    tracker: StatedBelief
    right: StatedBelief | None = None


class Course(NamedTuple):
    """One quantity over time, of the tracker and of what is right."""

    label: str
    """With the unit."""
    tracker: Array
    """``(k,)``"""
    right: Array | None = None
    """``(k,)``"""
    band: tuple[Array, Array] | None = None
    """``(k,)`` bounds of what is right."""
    band_name: str = ""


@dataclass(frozen=True, eq=False)
class OverTime(Exhibit):
    """Quantities over time, or over another variable."""

    title: str
    axis: str
    """What the quantities are drawn over, with its unit."""
    at: Array
    """``(k,)``"""
    courses: tuple[Course, ...]
    marked: tuple[float, float] | None = None
    """The interval that the finding names."""
    right_name: str = "reference"


class Ring(NamedTuple):
    """An ellipse ``(x - mean)^T covariance^-1 (x - mean) = size^2`` with its name."""

    name: str
    mean: Array
    """``(2,)``"""
    covariance: Array
    """``(2, 2)``"""
    size: float


@dataclass(frozen=True, eq=False)
class Points(Exhibit):
    """Points in a plane, and the ellipses that they are held against."""

    title: str
    axes: tuple[str, str]
    """With units."""
    name: str
    """What the points of the tracker are."""
    tracker: Array
    """``(2, n)``"""
    tracker_ring: Ring | None
    right_ring: Ring
    right: Array | None = None
    """``(2, n)``"""
    right_name: str = ""
    weight: tuple[float, float] | None = None
    """Of each of the tracker's points, and of each right one."""


def state_matrices(title: str, panels: tuple[Panel, ...], marked: tuple[tuple[int, int], ...]) -> Matrices:
    """Matrices ``(4, 4)`` of the state."""
    return Matrices(title, STATE, STATE, panels, marked)
