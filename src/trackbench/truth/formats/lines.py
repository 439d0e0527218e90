"""Text without a line of column names: rows of cells at fixed places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array
from trackbench.truth import jumps
from trackbench.truth.recorded.rows import NUMBER, text_of


class TextLine(NamedTuple):
    """The cells of a line."""

    number: int
    """From 1."""
    cells: list[str]


def read_lines(file: Path, separator: str | None, least: int, layout: str) -> list[TextLine]:
    """The lines of a file that are not empty.

    Args:
        file: the file.
        separator: between cells; None: white space.
        least: number of cells of a line; there may be more.
        layout: what they are, for messages.

    Raises:
        InputError: it cannot be read or is empty, or a line has fewer cells.
    """
    lines = []
    for number, text in enumerate(text_of(file).splitlines(), 1):
        if not text.strip():
            continue
        cells = [cell.strip() for cell in text.split(separator)]
        if len(cells) < least:
            message = f"{len(cells)} columns, where {least} are needed: {layout}"
            raise InputError(message, file=file, line=number)
        problem = jumps.why_no_name(cells[1]) or (None if cells[1] else "its id is empty")
        if problem is not None:
            raise InputError(problem, file=file, line=number)
        lines.append(TextLine(number, cells))
    return lines


def numbers_of(lines: Sequence[TextLine], column: int, file: Path) -> Array:
    """A column of finite numbers, of lengths or smaller ones.

    Raises:
        InputError: a cell is none.
    """
    values = np.empty(len(lines))
    for row, line in enumerate(lines):
        cell = line.cells[column]
        values[row] = float(cell) if NUMBER.fullmatch(cell) else math.nan
        if not abs(values[row]) <= jumps.LARGEST["length"]:
            message = f"column {column + 1} is {cell[:20]!r}, where a number up to {jumps.LARGEST['length']:.0e} is due"
            raise InputError(message, file=file, line=line.number)
    return values
