"""Tables of pages in Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """The lines of a table, whose first column is text, and an empty one."""
    yield f"| {' | '.join(headings)} |"
    yield f"| :-- |{' --: |' * (len(headings) - 1)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"
    yield ""
