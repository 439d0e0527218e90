"""The stretches of time into which the scores of a recording are cut."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Indices, Truth
from trackbench.truth.base import Recorded

#: s.
SHORTEST = 4.0


def stretch_of(time: Array, count: int) -> Indices:
    """``(T,)`` number of the stretch of each instant, s: ``count`` of equal time between the first and the last."""
    length = float(np.ptp(time)) / count
    return np.asarray(np.minimum(((time - time.min()) / length).astype(np.intp), count - 1))


def require_long_enough(truth: Truth, recorded: Mapping[str, Recorded], count: int) -> None:
    """Refuse to cut a recording into so many stretches.

    Raises:
        InputError: they are too short, or one has no scan.
    """
    scans = truth.time[np.concatenate([own.steps for own in recorded.values()])] if recorded else truth.time
    length = float(np.ptp(scans)) / count
    if length < SHORTEST:
        message = f"{count} stretches of {length * count:.3g} s are shorter than {SHORTEST:g} s each"
        raise InputError(f"{message}; at most {int(length * count / SHORTEST)}", key="truth.stretches")
    empty = np.flatnonzero(np.bincount(stretch_of(scans, count), minlength=count) == 0)
    if len(empty):
        start = float(scans.min()) + float(empty[0]) * length
        message = f"there is no scan from {start:.3g} to {start + length:.3g} s; take fewer"
        raise InputError(message, key="truth.stretches")
