"""A published number beside ours, and the tables that such rows make."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import wrap

import numpy as np
from benchmarks.markdown import table

from trackbench.base.types import Array
from trackbench.results.metric_value import MetricValue

COLUMNS = ("printed", "ours", "95 %")


@dataclass(frozen=True)
class Row:
    """One or several numbers that were printed for a quantity, and those that the bench gives."""

    quantity: str
    printed: tuple[float, ...]
    ours: tuple[float, ...]
    places: int
    """Decimal places in which the numbers are shown."""
    interval: tuple[float, float] | None = None
    """95 % interval of a single number; None where both sides take the same data, so that every digit has to agree."""
    why: str = ""
    """Cause of the difference, for a row that does not agree."""

    @property
    def agreeing(self) -> int:
        """How many of the printed numbers are inside the interval, or are ours when rounded."""
        if self.interval is not None:
            low, high = self.interval
            return int(low <= self.printed[0] <= high)
        return int(np.sum(np.round(self.ours, self.places) == np.round(self.printed, self.places)))

    @property
    def agrees(self) -> bool:
        """Whether every printed number does."""
        return self.agreeing == len(self.printed)

    def cells(self) -> tuple[str, ...]:
        """Return the row of the table as text."""
        interval = (
            "" if self.interval is None else f"{self._shown(self.interval[:1])} to {self._shown(self.interval[1:])}"
        )
        largest = max((round(a - b, self.places) for a, b in zip(self.ours, self.printed, strict=True)), key=abs)
        answer = (
            "yes"
            if self.agrees
            else "**no**"
            if len(self.printed) == 1
            else f"**{self.agreeing} of {len(self.printed)}**"
        )
        difference = f"{largest:+.{self.places}f}" if largest else "0"
        return self.quantity, self._shown(self.printed), self._shown(self.ours), interval, difference, answer

    def _shown(self, values: Sequence[float]) -> str:
        return " ".join(f"{value:.{self.places}f}" for value in values)


@dataclass(frozen=True)
class Source:
    """A publication with its rows."""

    title: str
    text: str
    """What was published where, and what ours is."""
    rows: tuple[Row, ...]
    columns: tuple[str, str, str] = COLUMNS
    """Headings over the published numbers, ours and the intervals; a table without intervals leaves the third out."""

    def section(self) -> Iterator[str]:
        """Yield the lines of the section of the page."""
        yield from (f"## {self.title}", "", self.text, "")
        lines = [("", *self.columns, "difference", "agrees"), *(row.cells() for row in self.rows)]
        if all(row.interval is None for row in self.rows):
            lines = [(*line[:3], *line[4:]) for line in lines]
        yield from table(lines[0], lines[1:])


def of_metric(quantity: str, printed: float, metric: MetricValue, places: int, why: str = "") -> Row:
    """Return the row of a metric of a result, with its interval over runs."""
    return Row(quantity, (printed,), (float(metric),), places, metric.ci95, why)


def of_runs(quantity: str, printed: float, values: Array, places: int, why: str = "") -> Row:
    """Return the row of a mean over independent runs, with Student's interval."""
    from scipy.stats import t

    mean, half = values.mean(), t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return Row(quantity, (printed,), (float(mean),), places, (float(mean - half), float(mean + half)), why)


def differing(sources: Sequence[Source]) -> Iterator[str]:
    """Yield the lines of the list of causes, each with the quantities that differ by it."""
    for source in sources:
        causes: dict[str, list[str]] = {}
        for row in source.rows:
            if not row.agrees:
                causes.setdefault(row.why, []).append(row.quantity)
        for why, quantities in causes.items():
            which = f"- **{source.title}: {'; '.join(quantities)}.** {why}"
            yield from wrap(which, 120, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    yield ""
