"""What a truth may be: nothing on earth is farther or faster, and the scores of what is within do not overflow."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from trackbench.base.errors import InputError
from trackbench.base.types import Truth

#: By quantity, in SI units and radians.
LARGEST = {"length": 1e8, "speed": 1e5, "angle": 1e6}
UNITS = {"length": "m", "speed": "m/s", "angle": "rad"}
#: Of a recording, s.
LONGEST = 86_400.0
#: Characters of an object's name.
LONGEST_NAME = 64

Position = Annotated[float, Field(ge=-LARGEST["length"], le=LARGEST["length"])]
Speed = Annotated[float, Field(ge=0, le=LARGEST["speed"])]
Velocity = Annotated[float, Field(ge=-LARGEST["speed"], le=LARGEST["speed"])]


def why_too_large(value: float, quantity: str | None) -> str | None:
    """What is wrong with a value in SI units or radians; None if nothing is. NaN stands for none."""
    if quantity is None or not abs(value) > LARGEST[quantity]:
        return None
    unit = UNITS[quantity]
    return f"it would be {value:.3g} {unit}, and at most {LARGEST[quantity]:.0e} {unit} can be meant: check its unit"


def why_too_long(seconds: float) -> str:
    """What is wrong with a time after the first of a recording."""
    return f"{seconds:.6g} s after the first, and a recording lasts {LONGEST:g} s at most: check the unit of time"


def why_no_name(name: str) -> str | None:
    """What is wrong with the name of an object, which goes into reports, recordings and XML; None if nothing is."""
    if not name.isprintable():
        return f"{name[:LONGEST_NAME]!r} has a character that cannot be printed, and names an object"
    if len(name) > LONGEST_NAME:
        return f"{name[:20] + '...'!r} has {len(name)} characters; the name of an object has at most {LONGEST_NAME}"
    return None


def require_possible(truth: Truth) -> None:
    """Make sure that a truth can be scored and shown.

    Raises:
        InputError: an object has a name that cannot be written, or is too far away or too fast.
    """
    for index, name in enumerate(truth.ids):
        problem = why_no_name(name)
        if problem is not None:
            raise InputError(problem, key="truth")
        for what, values, quantity in (
            ("speed", truth.speed, "speed"),
            ("x", truth.px, "length"),
            ("y", truth.py, "length"),
        ):
            largest = np.abs(values[:, index]).max(axis=-1)
            step = int(np.argmax(~(largest <= LARGEST[quantity])))
            if not largest[step] <= LARGEST[quantity]:
                found = f"{what} of {name} becomes {largest[step]:.3g} {UNITS[quantity]} at {truth.time[step]:g} s"
                raise InputError(f"{found}; at most {LARGEST[quantity]:.0e} is possible", key="truth")
