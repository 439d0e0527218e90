"""Checks of the values that a plug-in's methods return."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.base.errors import TrackbenchError, shortened_text
from trackbench.base.types import Mask


def require(is_right: bool, what: str, right: str, answer: object) -> None:
    """Raise an error unless ``is_right``, for an ``answer`` that a plug-in's method returned.

    Raises:
        TrackbenchError: ``is_right`` is False: "<what> must be <right>, not <answer>".
    """
    if is_right:
        return
    text = f"one of shape {answer.shape} of {answer.dtype}" if isinstance(answer, np.ndarray) else repr(answer)
    shown = shortened_text(" ".join(text.split()), 100)
    raise TrackbenchError(f"{what} must be {right}, not {shown}")


def require_array(what: str, answer: Any, shapes: Sequence[tuple[int, ...]], finite: Mask | bool = True) -> None:
    """Make sure that a plug-in returned an array of numbers.

    Args:
        what: name of the value in the message.
        answer: returned value.
        shapes: shapes that the array may have; the message names the first.
        finite: mask of the numbers that must be finite, of a shape that broadcasts with the array's.

    Raises:
        TrackbenchError: it is no array of real numbers, has another shape, or a number is not finite.
    """
    is_array = isinstance(answer, np.ndarray) and answer.dtype.kind in "biuf" and answer.shape in shapes
    require(is_array, what, f"an array of numbers of shape {shapes[0]}", answer)
    wrong = finite & ~np.isfinite(answer)
    if wrong.any():
        require(False, what, "finite", float(np.broadcast_to(answer, wrong.shape)[wrong][0]))
