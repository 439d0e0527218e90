"""Results with other differences between their trackers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from trackbench.results import Difference, Result, Tables, difference_table


def with_differences(result: Result, differences: Iterable[Difference]) -> Result:
    """The same result with these."""
    return replace(result, tables=Tables({**result.tables, "differences": difference_table(differences)}))
