"""Checks of a stored result: sha256 digests of files, and differences from the values and tables of a repetition."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.base.errors import InputError
from trackbench.base.files import require_regular
from trackbench.results.folder import sha256

if TYPE_CHECKING:
    import pyarrow as pa

#: Relative difference of two values that is attributed to rounding.
ROUNDING = 1e-9


def why_other_content(file: Path, digest: str) -> str | None:
    """Return why a file does not have the sha256 ``digest``: it is missing or differs; None if it has it."""
    try:
        require_regular(file)
        return None if sha256(file) == digest else "its sha256 is not the stated one"
    except FileNotFoundError:
        return "there is no such file"


def stored_table(file: Path, digest: str | None, stated_in: str) -> pa.Table:
    """Return the table in a Parquet file, if the file has the expected sha256.

    Args:
        file: the Parquet file.
        digest: expected sha256; None if unknown.
        stated_in: name of the file that states the sha256.

    Raises:
        FileNotFoundError: there is no such file.
        InputError: the file has another sha256, or cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        require_regular(file)
        if digest is not None and sha256(file) != digest:
            raise InputError(f"not the table that this run wrote: its sha256 is not the one in {stated_in}", file=file)
        return pq.read_table(file)
    except FileNotFoundError:
        raise
    except (OSError, ValueError, pa.ArrowException) as error:
        raise InputError(f"not a readable table: {' '.join(str(error).split())}", file=file) from error


def differing(stated: Any, actual: Any, tolerance: float = 0.0, at: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield the key of each value that differs between two trees of JSON values, with both values.

    Args:
        stated: first tree.
        actual: second tree.
        tolerance: relative difference up to which numbers are equal.
        at: key of both trees, a prefix of all keys.
    """
    if isinstance(stated, Mapping) and isinstance(actual, Mapping):
        for key in {**stated, **actual}:
            yield from differing(stated.get(key), actual.get(key), tolerance, f"{at}.{key}" if at else str(key))
    elif tolerance and isinstance(stated, list) and isinstance(actual, list) and len(stated) == len(actual):
        for index, (ours, theirs) in enumerate(zip(stated, actual, strict=True)):
            yield from differing(ours, theirs, tolerance, f"{at}.{index}")
    elif tolerance and isinstance(stated, float) and isinstance(actual, float):
        if not math.isclose(stated, actual, rel_tol=tolerance, abs_tol=tolerance):
            yield at, stated, actual
    elif stated != actual:
        yield at, stated, actual


def table_difference(stated: pa.Table, actual: pa.Table, tolerance: float = ROUNDING) -> str | None:
    """Say where two tables first differ, by column and row from 0; None if they are equal.

    Args:
        stated: first table.
        actual: second table.
        tolerance: relative difference up to which numbers are equal.
    """
    import numpy as np

    if stated.column_names != actual.column_names:
        return "the columns differ"
    if len(stated) != len(actual):
        return f"the table has {len(stated)} rows, and recomputing gives {len(actual)}"
    for name in stated.column_names:
        ours, theirs = (np.asarray(table[name].to_pandas()) for table in (stated, actual))
        if ours.dtype.kind == "f":
            differs = ~np.isclose(ours, theirs, rtol=tolerance, atol=tolerance, equal_nan=True)
        else:
            differs = ours != theirs
        if differs.any():
            row = int(np.argmax(differs))
            return f"row {row}, {name}: the table has {ours[row]}, and recomputing gives {theirs[row]}"
    return None
