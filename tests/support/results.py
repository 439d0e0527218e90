"""Results with other tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pyarrow as pa

from trackbench.results import Difference, Result, Tables, difference_table


def with_tables(result: Result, **tables: pa.Table) -> Result:
    """The same result with these tables in the place of its own."""
    return replace(result, tables=Tables({**result.tables, **tables}))


def with_differences(result: Result, differences: Iterable[Difference]) -> Result:
    """The same result with these differences between its trackers."""
    return with_tables(result, differences=difference_table(differences))
