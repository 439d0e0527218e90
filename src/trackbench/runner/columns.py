"""Columns of numbers and names to a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from trackbench.types import Array

Columns = dict[str, Array | list[str]]


def stacked(parts: Sequence[Columns]) -> pa.Table:
    """One table of parts with the same columns."""
    if not parts:
        return pa.table({})
    joined: dict[str, pa.Array] = {}
    for key in parts[0]:
        values = [part[key] for part in parts]
        if isinstance(values[0], list):
            joined[key] = pa.array([text for part in values for text in part], pa.string()).dictionary_encode()
        else:
            joined[key] = pa.array(np.concatenate(values), from_pandas=True)
    return pa.table(joined)
