"""Numbers as people and programs write them."""

from __future__ import annotations

import math
import re

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


def stated_number(text: str) -> float:
    """Return the number that a text is, in the digits 0 to 9; NaN where it is none, infinity where it is too large."""
    return float(text) if _NUMBER.fullmatch(text) else math.nan
