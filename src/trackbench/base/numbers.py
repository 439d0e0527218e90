"""Conversion to numbers of texts that people and programs write."""

from __future__ import annotations

import math
import re

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


def stated_number(text: str) -> float:
    """Return the number in a text of digits 0 to 9; NaN for any other text, infinity for a number too large."""
    return float(text) if _NUMBER.fullmatch(text) else math.nan
