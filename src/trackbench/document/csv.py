"""The tables of a document as CSV (RFC 4180): the numbers that are shown, with their units in the headings."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

from trackbench.document.model import Table

_PLAIN = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " "})


def to_csv(table: Table) -> str:
    """The text of a CSV file; the small print of a column is a column of its own beside it."""
    detailed = [any(row[i].details for row in table.rows) for i in range(len(table.columns))]
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(list(_headings(table, detailed)))
    for row in table.rows:
        cells = zip(row, detailed, strict=True)
        writer.writerow(
            [
                text.translate(_PLAIN)
                for cell, has in cells
                for text in ([cell.text, "; ".join(cell.details)] if has else [cell.text])
            ]
        )
    return text.getvalue()


def _headings(table: Table, detailed: list[bool]) -> Iterator[str]:
    for column, has in zip(table.columns, detailed, strict=True):
        yield column.heading
        if has:
            yield f"{column.heading}: {column.details}"
