"""What a finding shows, as data for a figure: the wrong numbers beside the right ones, and how these are computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import COMMON_STATE, Array, Estimate
from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.expected_gain import joseph, linearised_gain
from trackbench.subjects.doctor.trial import Trial

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


def largest_entry(matrix: Array) -> tuple[int, int]:
    """The row and the column of the largest entry."""
    row, column = np.unravel_index(int(np.argmax(matrix)), matrix.shape)
    return int(row), int(column)


def state_matrices(title: str, panels: tuple[Panel, ...], marked: tuple[tuple[int, int], ...]) -> Matrices:
    """Matrices ``(4, 4)`` of the state."""
    return Matrices(title, STATE, STATE, panels, marked)


#: White acceleration of the right prediction, m/s^2: that of the reference.
ACCELERATION = 3.0


def stated_belief(name: str, estimate: Estimate) -> StatedBelief:
    """An estimate with a name."""
    return StatedBelief(name, estimate.mean, estimate.covariance)


def straight(step: float) -> Array:
    """``(4, 4)`` the transition with constant velocity over ``step`` s."""
    return np.eye(4) + step * np.eye(4, k=2)


def predicted(estimate: Estimate, step: float, name: str = "right: velocity times the time step") -> StatedBelief:
    """Moved with constant velocity over ``step`` s, with a white acceleration of the reference's size."""
    f = straight(step)
    g = np.vstack([0.5 * step**2 * np.eye(2), step * np.eye(2)])
    covariance = f @ estimate.covariance @ f.T + ACCELERATION**2 * g @ g.T
    return StatedBelief(name, f @ estimate.mean, covariance)


def updated(trial: Trial, measurement: Array, name: str = "right") -> StatedBelief:
    """The prediction after a measurement, by the equations of the extended Kalman filter in Joseph's form."""
    gain = linearised_gain(trial)
    innovation = difference(measurement, trial.predicted_measurement, SENSOR_MODELS[trial.scan.kind].angular)
    return StatedBelief(name, trial.prediction.mean + gain @ innovation, joseph(trial, gain))


def update_shown(trial: Trial, measurement: Array) -> Predictions | None:
    """The prediction, the tracker's update by a measurement, and the right one."""
    after = trial.posterior(measurement)
    if after is None:
        return None
    return Predictions(
        f"Update with {trial.scan.sensor}: {trial.description}",
        stated_belief("before the measurement", trial.prediction),
        stated_belief("tracker, after it", after),
        updated(trial, measurement, "right, after it"),
    )


def reduction_shown(trial: Trial, after: Estimate) -> Covariances:
    """The covariance before and after a measurement, and the right one."""
    return Covariances(
        f"Covariance before and after a measurement of {trial.scan.sensor}",
        stated_belief("before the measurement", trial.prediction),
        stated_belief("tracker, after it", after),
        updated(trial, trial.predicted_measurement, "right, after it"),
    )


def measurement_shown(trial: Trial, used: Array, clear: float) -> Matrices:
    """The measurement that has no innovation beside the right one; marked are the components ``clear`` sigma apart."""
    right = trial.predicted_measurement
    apart = np.abs(used - right) / trial.sigma
    wrong = np.flatnonzero(apart > min(clear, float(apart.max())) * (1.0 - 1e-9))
    return Matrices(
        f"Predicted measurement of {trial.scan.sensor}: {trial.description}",
        components_of(trial.scan.kind),
        ("value",),
        (Panel("tracker", used[:, None]), Panel("right", right[:, None], "right")),
        tuple((int(i), 0) for i in wrong),
    )


def gain_shown(trial: Trial, applied: Array, right: Array) -> Matrices:
    """A gain ``(4, m)`` beside the right one; marked is the entry of each column that is furthest from it."""
    apart = np.abs((applied - right) * trial.sigma / trial.state_sigma[:, None])
    return Matrices(
        f"Gain of {trial.scan.sensor}: {trial.description}",
        STATE,
        components_of(trial.scan.kind),
        (Panel("tracker", applied), Panel("right", right, "right")),
        tuple((int(np.argmax(apart[:, i])), i) for i in range(apart.shape[1])),
    )


#: Of the state px, py, vx, vy.
COUNT = 8
#: Standard deviations of an ellipse that is drawn.
SIZE = 2.0


def points_shown(before: Estimate, after: Estimate, *, weights: float = 1.0, rows: bool = False) -> Points:
    """The points that an estimate has, and those with the covariance that a prediction over no time makes of it.

    Args:
        before: what the points are drawn from.
        after: what the prediction makes of it.
        weights: the sum of the weights. Where it is wrong the points are right.
        rows: whether the points lie along the rows of the lower Cholesky factor, not along its columns.
    """
    factor = np.asarray(np.linalg.cholesky(linalg.symmetrise(before.covariance)), dtype=float)
    applied = factor.T if rows and weights == 1.0 else factor
    predicted = linalg.symmetrise(after.covariance)
    if weights == 1.0 and not rows and np.linalg.eigvalsh(predicted)[0] > 0.0:
        applied = np.asarray(np.linalg.cholesky(predicted), dtype=float)
    # The difference of rows from columns is in px, vx: px, py are nearly uncorrelated with each other.
    plane = slice(0, 4, 2) if rows else slice(0, 2)
    names = STATE[plane]
    return Points(
        "Sigma points with the effect that was found",
        (names[0], names[1]),
        "as in the tracker",
        _drawn(before.mean, applied)[plane],
        _ring("covariance after the prediction", after, plane),
        _ring("covariance before it", before, plane),
        _drawn(before.mean, factor)[plane],
        "right",
        (weights / COUNT, 1.0 / COUNT),
    )


def _drawn(mean: Array, factor: Array) -> Array:
    spread = np.sqrt(COUNT / 2) * factor
    return np.asarray(mean[:, None] + np.hstack([spread, -spread]))


def _ring(name: str, estimate: Estimate, plane: slice) -> Ring:
    return Ring(f"{name}, {SIZE:g} sigma", estimate.mean[plane], estimate.covariance[plane, plane], SIZE)


def told_apart(one: float, other: float) -> tuple[str, str]:
    """Two numbers with as many digits as tell them apart, three at least."""
    texts = [(f"{one:.{digits}g}", f"{other:.{digits}g}") for digits in range(3, 17)]
    return next((pair for pair in texts if pair[0] != pair[1]), texts[0])
