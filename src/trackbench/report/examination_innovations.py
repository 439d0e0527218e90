"""Which innovations of an exhibit tell something, and where."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.doctor.exhibits import Innovations

#: Innovations taken and sound that are further apart, in standard deviations of the measurement, are not the same.
APART = 3.0


class Departure(NamedTuple):
    """The first measurement that is not taken for what it is."""

    component: str
    time: float
    """s"""
    taken: float
    sound: float


def telling(innovations: Innovations) -> list[int]:
    """The components that are taken for something else than they are; all where none is."""
    found = np.flatnonzero((_gap(innovations) > APART).any(axis=1))
    return [int(i) for i in found] or list(range(len(innovations.components)))


def departure(innovations: Innovations) -> Departure | None:
    """Where a component is first taken for something else; None if none is."""
    gap = _gap(innovations)
    columns = np.flatnonzero((gap > APART).any(axis=0))
    if not len(columns):
        return None
    k = int(columns[0])
    i = int(np.argmax(gap[:, k]))
    return Departure(
        innovations.components[i],
        float(innovations.time[k]),
        float(innovations.taken[i, k]),
        float(innovations.sound[i, k]),
    )


def innovation_unit(component: str) -> str:
    """The unit of a component of a measurement."""
    return {"azimuth": "rad", "range_rate": "m/s", "speed": "m/s"}.get(component, "m")


def _gap(innovations: Innovations) -> np.ndarray:
    gap = np.abs(innovations.taken - innovations.sound) / innovations.sigma[:, None]
    return np.nan_to_num(gap, nan=0.0)
