"""What is scored: one run's objects and tracks over time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask

#: In place of the origin of a detection: the track took none.
NO_DETECTION = -2

Status = npt.NDArray[np.int8]


class TruthHistory(NamedTuple):
    """T instants of N objects."""

    time: Array
    """``(T,)`` s, increasing."""
    state: Array
    """``(4, T, N)`` px, py, vx, vy in the fixed frame."""
    status: Status
    """``(T, N)``: ``ABSENT``, ``OPTIONAL`` (a track on it is neither right nor wrong) or ``DUE``."""


class TrackHistory(NamedTuple):
    """The tracks that a tracker gave at the T instants, in K columns of no meaning."""

    ids: Indices
    """``(T, K)``, -1 where a column is empty."""
    mean: Array
    """``(4, T, K)``."""
    covariance: Array
    """``(4, 4, T, K)``."""
    existence: Array | None = None
    """``(T, K)``."""


class Associations(NamedTuple):
    """Which detection each track took in each of S scans, and what caused it."""

    instant: Indices
    """``(S,)`` the instant of each scan, in order."""
    ids: Indices
    """``(S, K)`` the tracks after the scan, -1 where a column is empty."""
    origin: Indices
    """``(S, K)`` the object that caused the detection, ``FALSE_ALARM``, or ``NO_DETECTION`` where none was taken."""
    detected: Mask
    """``(S, N)`` which objects caused a detection in the scan."""
    merged: Indices | None = None
    """``(S, K)`` the second object of a detection that two objects caused, else negative."""
