"""Whether what is stated of a result holds: the digest of a file, a table, and the values of what was made again."""

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

#: Values that differ by less, relative to the larger, differ by rounding.
ROUNDING = 1e-9


def why_other_content(file: Path, digest: str) -> str | None:
    """Say why a file is not the one with a sha256; None where it is."""
    try:
        require_regular(file)
        return None if sha256(file) == digest else "has another sha256 than is stated of it"
    except FileNotFoundError:
        return "there is no such file"


def stored_table(file: Path, digest: str | None, stated_in: str) -> pa.Table:
    """Return the table in a Parquet file.

    Args:
        file: the file.
        digest: its sha256; None where nothing states it.
        stated_in: the file that states it.

    Raises:
        FileNotFoundError: it is not there.
        InputError: it has another sha256, or cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        require_regular(file)
        if digest is not None and sha256(file) != digest:
            raise InputError(f"not the table that this run wrote: {stated_in} has another sha256 of it", file=file)
        return pq.read_table(file)
    except FileNotFoundError:
        raise
    except (OSError, ValueError, pa.ArrowException) as error:
        raise InputError(f"not a readable table: {' '.join(str(error).split())}", file=file) from error


def differing(stated: Any, found: Any, tolerance: float = 0.0, at: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield the key of each value that differs between two trees of JSON values, with both values.

    Args:
        stated: one of them.
        found: the other.
        tolerance: relative difference up to which numbers are equal.
        at: the key of both.
    """
    if isinstance(stated, Mapping) and isinstance(found, Mapping):
        for key in {**stated, **found}:
            yield from differing(stated.get(key), found.get(key), tolerance, f"{at}.{key}" if at else str(key))
    elif tolerance and isinstance(stated, list) and isinstance(found, list) and len(stated) == len(found):
        for index, (ours, theirs) in enumerate(zip(stated, found, strict=True)):
            yield from differing(ours, theirs, tolerance, f"{at}.{index}")
    elif tolerance and isinstance(stated, float) and isinstance(found, float):
        if not math.isclose(stated, found, rel_tol=tolerance, abs_tol=tolerance):
            yield at, stated, found
    elif stated != found:
        yield at, stated, found


def table_difference(stated: pa.Table, found: pa.Table, tolerance: float = ROUNDING) -> str | None:
    """Say where two tables first differ, by column and row from 0; None where they do not.

    Args:
        stated: one of them.
        found: the other.
        tolerance: relative difference up to which numbers are equal.
    """
    import numpy as np

    if stated.column_names != found.column_names:
        return "the columns differ"
    if len(stated) != len(found):
        return f"{len(stated)} rows are stated, {len(found)} come again"
    for name in stated.column_names:
        ours, theirs = (np.asarray(table[name].to_pandas()) for table in (stated, found))
        if ours.dtype.kind == "f":
            differs = ~np.isclose(ours, theirs, rtol=tolerance, atol=tolerance, equal_nan=True)
        else:
            differs = ours != theirs
        if differs.any():
            row = int(np.argmax(differs))
            return f"row {row}, {name}: {ours[row]} is stated, {theirs[row]} comes again"
    return None
