"""The text format of the Udacity term-2 simulator: one measurement of one object a line, with its truth.

L  px     py                   timestamp_us  px py vx vy [yaw [yaw_rate]]
R  range  azimuth  range_rate  timestamp_us  px py vx vy [yaw [yaw_rate]]
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from trackbench.base.errors import InputError
from trackbench.truth.limits import why_too_large

#: The sensor that each letter stands for, and the components of its measurement.
SENSORS: dict[str, tuple[str, tuple[str, ...]]] = {
    "L": ("lidar", ("px", "py")),
    "R": ("radar", ("range", "azimuth", "range rate")),
}
TRUTH = ("px", "py", "vx", "vy")
#: Columns of the truth that older files leave out.
OPTIONAL = ("yaw", "yaw rate")

#: Of what each of them is.
QUANTITIES = {
    **dict.fromkeys(("px", "py", "range"), "length"),
    **dict.fromkeys(("vx", "vy", "range rate"), "speed"),
    **dict.fromkeys(("azimuth", *OPTIONAL), "angle"),
}

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
#: Whole microseconds that a double holds exactly.
_STAMP = re.compile(r"[0-9]{1,16}")


class Measurement(NamedTuple):
    """One line."""

    kind: str
    """"lidar" or "radar"."""
    measurement: tuple[float, ...]
    """Lidar: x, y, m. Radar: range m, azimuth rad as recorded (it may lie outside (-pi, pi]), range rate m/s."""
    stamp: int
    """us"""
    truth: tuple[float, float, float, float]
    """px, py m, vx, vy m/s."""
    yaw: float | None = None
    """rad; None in older files."""
    yaw_rate: float | None = None
    """rad/s; None in older files."""


def parse_line(text: str) -> Measurement:
    """The measurement that a line states. Columns are separated by white space, ends of line do not matter.

    Raises:
        InputError: an unknown letter, a column that is missing, too many or not a finite number.
    """
    letter, *columns = text.split() or [""]
    if letter not in SENSORS:
        raise InputError(f"a line begins with L (lidar) or R (radar), not {_short(letter)}")
    kind, components = SENSORS[letter]
    needed = (*components, "time stamp", *TRUTH)
    if len(columns) < len(needed):
        missing = needed[len(columns)]
        what = f"the truth ({', '.join(TRUTH)})" if missing == TRUTH[0] else f"{missing} (column {len(columns) + 2})"
        raise InputError(f"the {letter} line ends before {what}")
    if len(columns) > len(needed) + len(OPTIONAL):
        most = 1 + len(needed) + len(OPTIONAL)
        raise InputError(f"the {letter} line has {len(columns) + 1} columns, where {most} are the most")
    size = len(components)
    stamp = columns.pop(size)
    if not _STAMP.fullmatch(stamp):
        raise InputError(f"the time stamp is a whole number of microseconds, not {_short(stamp)}")
    names = (*components, *TRUTH, *OPTIONAL)
    values = [
        _number(column, name if i < size else f"true {name}", QUANTITIES[name])
        for i, (column, name) in enumerate(zip(columns, names, strict=False))
    ]
    px, py, vx, vy, *rest = values[size:]
    return Measurement(kind, tuple(values[:size]), int(stamp), (px, py, vx, vy), *rest)


def _number(text: str, name: str, quantity: str) -> float:
    value = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not math.isfinite(value):
        raise InputError(f"{name} is not a finite number: {_short(text)}")
    problem = why_too_large(value, quantity)
    if problem is not None:
        raise InputError(f"{name} is {_short(text)}: {problem}")
    return value


def _short(text: str) -> str:
    return repr(text if len(text) <= 20 else text[:17] + "...")
