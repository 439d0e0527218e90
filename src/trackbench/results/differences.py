"""The differences between the trackers of a result, and their table."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.results.declared import SHARED
from trackbench.results.metric_value import ResultModel

if TYPE_CHECKING:
    import pyarrow as pa

#: The fields that are columns of the table, by whether they may be missing.
_NAMES = {"a": False, "b": False, "metric": False, "unit": False, "better": True, "verdict": True}
_NUMBERS = ("value", "margin", "p_value", "without_charged")


class Difference(ResultModel):
    """The value of one tracker minus that of another, paired over the runs."""

    a: str
    b: str
    metric: str
    unit: str
    value: float
    ci95: tuple[float, float] | None
    margin: float
    """Up to this a difference does not matter."""
    p_value: float | None
    """Of the hypothesis that the difference is within the margin, corrected for the number of differences in the
    family; None of a difference that is in none."""
    better: str | None
    """The tracker that is shown to be better by more than the margin."""
    verdict: str | None
    """The same in words; ``larger`` and ``smaller``, of ``a``, where the difference is shown and neither is better.
    None of a difference that is in no family."""
    without_charged: float | None = None
    """The same over the estimates that were given alone, where over a tenth of the squared error of either is charged
    for missing ones. Neither is called better where this has the other sign."""

    @property
    def turned(self) -> bool:
        """Whether the difference is shown, and neither is called better since it turns without what is charged."""
        shown = self.verdict in ("larger", "smaller")
        return shown and self.without_charged is not None and self.without_charged * self.value < 0

    @property
    def _row(self) -> dict[str, Any]:
        """By column; a name that is missing is empty, and a number NaN."""
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        numbers["ci95_low"], numbers["ci95_high"] = self.ci95 or (None, None)
        return {
            **{name: getattr(self, name) or "" for name in _NAMES},
            **{name: np.nan if value is None else value for name, value in numbers.items()},
        }


def difference_table(differences: Iterable[Difference]) -> pa.Table:
    """The table ``differences``; without columns where there is none."""
    rows = [item._row for item in differences]
    record = {name: [row[name] for row in rows] for name in rows[0]} if rows else {}
    return SHARED["differences"].written([record] if rows else [])


def differences_of(table: pa.Table) -> list[Difference]:
    """The rows of the table as differences."""
    differences = []
    for row in table.to_pylist():
        ends = row["ci95_low"], row["ci95_high"]
        values = {name: row[name] or None if missing else row[name] for name, missing in _NAMES.items()}
        values |= {name: row[name] for name in _NUMBERS}
        differences.append(Difference(**values, ci95=None if None in ends else ends))
    return differences
