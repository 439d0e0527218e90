"""Tables of a result in Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from trackbench.report.tables import Cell, Table, ranked
from trackbench.report.wording import failure, unscored
from trackbench.results import RunResult

#: What Markdown or HTML could take for its own; an underscore inside a word is safe.
_SPECIAL = re.compile(r"[\\`*\[\]<>|]|(?<!\w)_|_(?!\w)")


def table(result: RunResult) -> str:
    """The ranked table of a run, its footnotes, and the trackers without a score."""
    found = ranked(result.summary)
    lines = grid([heading for heading, _ in found.headings], ([_cell(found, c) for c in row] for row in found.rows))
    if found.reasons:
        lines += ["", *(f"{i}. n/a: {escape(reason)}" for i, reason in enumerate(found.reasons, 1))]
    missing = unscored(result.summary)
    if missing:
        lines += ["", "Without a score:", ""]
        lines += [f"- **{escape(tracker['name'])}**: {escape(failure(tracker))}" for tracker in missing]
    return "\n".join(lines) + "\n"


def grid(headings: Sequence[str], rows: Iterable[Sequence[str]], left: int = 2) -> list[str]:
    """The lines of a table; the first ``left`` columns are flush left, the others right. Cells are Markdown."""
    rule = [":--" if i < left else "--:" for i in range(len(headings))]
    return [_row([escape(heading) for heading in headings]), _row(rule), *(_row(row) for row in rows)]


def escape(text: str) -> str:
    """``text`` as it is, in one line, whatever Markdown or HTML it looks like."""
    return _SPECIAL.sub(r"\\\g<0>", " ".join(text.split()))


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _cell(found: Table, cell: Cell) -> str:
    text = f"**{escape(cell.text)}**" if cell.tracker else escape(cell.text)
    mark = f"<sup>{found.mark(cell)}</sup>" if cell.reason else ""
    details = f" ({escape(', '.join(cell.details))})" if cell.details else ""
    return text + mark + details
