"""A document as Markdown, with the tables of GitHub."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from trackbench.document import (
    Block,
    Cell,
    Code,
    Document,
    Figure,
    Items,
    Paragraph,
    Row,
    Section,
    Status,
    Table,
    with_powers,
    without_figures,
)

_SPACES = re.compile("[^\\S\N{NO-BREAK SPACE}]+")
#: What Markdown or HTML could take for its own; an underscore inside a word is safe.
_SPECIAL = re.compile(r"[\\`*\[\]<>|]|(?<!\w)_|_(?!\w)")


def to_markdown(document: Document, *, figures: str = "") -> str:
    """The text of a Markdown file.

    Args:
        document: what it says.
        figures: the folder of the figures' SVG files, relative to the file; without one it has no figures.
    """
    lines = [f"# {escape_markdown(document.title)}", ""]
    if document.lead:
        lines += [escape_markdown(document.lead), ""]
    if document.facts:
        lines += [escape_markdown(", ".join(document.facts)), ""]
    for block in document.blocks if figures else without_figures(document.blocks):
        lines += _lines(block, 2, figures)
    return "\n".join(lines).rstrip("\n") + "\n"


def escape_markdown(text: str) -> str:
    """``text`` as it is, in one line, whatever Markdown or HTML it looks like."""
    return _SPECIAL.sub(r"\\\g<0>", _SPACES.sub(" ", with_powers(text)).strip())


def _lines(block: Block, level: int, figures: str) -> Iterator[str]:
    """The lines of a block, an empty one last."""
    match block:
        case Section():
            yield from (f"{'#' * level} {escape_markdown(block.title)}", "")
            for inner in block.blocks:
                yield from _lines(inner, level + 1, figures)
        case Row():
            for inner in block.blocks:
                yield from _lines(inner, level, figures)
        case Paragraph():
            yield from (f"**{escape_markdown(block.text)}**" if block.strong else escape_markdown(block.text), "")
        case Status():
            yield from (f"{escape_markdown(block.text)}.", "")
        case Items():
            yield from (*_items(block), "")
        case Code():
            yield from (*_fenced(block), "")
        case Table():
            yield from (*_table(block), "")
        case Figure():
            yield from (
                f"![{escape_markdown(block.alternative)}]({figures}/{block.name}.svg)",
                "",
                escape_markdown(block.caption),
                "",
            )


def _items(block: Items) -> Iterator[str]:
    for number, item in enumerate(block.items, 1):
        mark = f"{number}." if block.numbered else "-"
        label = f"**{escape_markdown(item.label)}**: " if item.label else ""
        detail = f" ({escape_markdown(item.detail)})" if item.detail else ""
        yield f"{mark} {label}{escape_markdown(item.text)}{detail}"


def _fenced(block: Code) -> list[str]:
    """In a fence that is longer than any in it."""
    longest = max((len(match) for match in re.findall("`+", block.text)), default=0)
    fence = "`" * max(3, longest + 1)
    return [f"{fence}{block.language}", block.text.rstrip("\n"), fence]


def _table(table: Table) -> Iterator[str]:
    if table.caption:
        yield from (f"{escape_markdown(table.caption)}:", "")
    yield _row([escape_markdown(column.heading) for column in table.columns])
    yield _row([":--" if column.left else "--:" for column in table.columns])
    for row in table.rows:
        yield _row([_cell(table, cell) for cell in row])
    if table.reasons:
        yield ""
    for number, reason in enumerate(table.reasons, 1):
        yield f"{number}. n/a: {escape_markdown(reason)}"


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _cell(table: Table, cell: Cell) -> str:
    text = escape_markdown(cell.text)
    if cell.link:
        text = f"[{text}]({cell.link})"
    if cell.strong or cell.tracker:
        text = f"**{text}**"
    mark = f"<sup>{table.mark(cell)}</sup>" if cell.reason else ""
    details = f" ({escape_markdown(', '.join(cell.details))})" if cell.details else ""
    return text + mark + details
