"""Where the applied and the expected innovations of an evidence run differ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.subjects.doctor.evidence import SensorInnovations
from trackbench.subjects.doctor.exhibits import UNITS

#: Difference from which on applied and expected innovation are not the same, in standard deviations of the measurement.
DIFFERENT = 3.0


class Mismatch(NamedTuple):
    """The first measurement whose applied innovation is not the expected one."""

    component: str
    time: float
    """s"""
    applied: float
    expected: float


def mismatched_components(innovations: SensorInnovations) -> list[int]:
    """The components with a mismatch; all components if there is none."""
    found = np.flatnonzero((_gap(innovations) > DIFFERENT).any(axis=1))
    return [int(i) for i in found] or list(range(len(innovations.components)))


def first_mismatch(innovations: SensorInnovations) -> Mismatch | None:
    """The first mismatch; None if there is none."""
    gap = _gap(innovations)
    columns = np.flatnonzero((gap > DIFFERENT).any(axis=0))
    if not len(columns):
        return None
    k = int(columns[0])
    i = int(np.argmax(gap[:, k]))
    return Mismatch(
        innovations.components[i],
        float(innovations.time[k]),
        float(innovations.applied[i, k]),
        float(innovations.expected[i, k]),
    )


def innovation_unit(component: str) -> str:
    """The unit of a component of a measurement."""
    return UNITS.get(component, "m")


def _gap(innovations: SensorInnovations) -> np.ndarray:
    gap = np.abs(innovations.applied - innovations.expected) / innovations.sigma[:, None]
    return np.nan_to_num(gap, nan=0.0)
