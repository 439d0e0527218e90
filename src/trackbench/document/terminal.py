"""A document as text in a terminal, without its figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from trackbench.document import (
    Block,
    Cell,
    Code,
    Document,
    Item,
    Items,
    Paragraph,
    Row,
    Section,
    Status,
    Table,
    without_figures,
)

STYLE = {"good": "green", "warn": "yellow", "bad": "bold red", "": ""}
#: Characters of the widest column of a table; longer texts break.
_WIDEST = 40


def print_document(document: Document, console: Console) -> None:
    """Print a document without its figures, the answer first.

    The columns of a table wider than the console continue below, beside a copy of its left columns.
    """
    blocks = without_figures(document.blocks)
    answer = blocks[0] if blocks else None
    title, lead = document.title, document.lead
    if isinstance(answer, Status):
        _say(console, Text(f"{title.replace(': ', ' of ')}: {answer.text}", style=STYLE[answer.tone] or "bold"))
    elif isinstance(answer, Items) or (isinstance(answer, Paragraph) and answer.strong):
        _print(answer, console)
        _say(console, Text(title, style="dim"))
    else:
        answer = None
        _say(console, Text(f"{title.replace(': ', ' of ')}: {lead}" if lead else title, style="bold"))
        lead = ""
    if lead:
        _say(console, Text(lead))
    if document.facts:
        _say(console, Text(", ".join(document.facts), style="dim"))
    for block in blocks[answer is not None :]:
        _print(block, console)


def print_table(table: Table, console: Console, gap: int = 2) -> None:
    """Print a table with its caption and footnotes, and ``gap`` spaces between two columns."""
    if table.caption:
        _say(console, Text(f"{table.caption}:"))
    widths, keys = [_width(table, i) for i in range(len(table.columns))], _keys(table)
    parts = list(fitting_columns(widths, keys, console.width, gap))
    if len(parts) > 1 and sum(width + gap for width in widths[:keys]) > console.width / 2:
        for row in table.rows:
            _print_record(table, row, console)
        parts = []
    for columns in parts:
        grid = Grid(box=None, pad_edge=False, padding=(0, gap, 0, 0), header_style="dim")
        for i in columns:
            column = table.columns[i]
            grid.add_column(column.heading, justify="left" if column.left else "right", overflow="fold")
        for row in table.rows:
            grid.add_row(*(_cell(table, row[i]) for i in columns))
        console.print(grid)
    for number, reason in enumerate(table.reasons, 1):
        _say(console, Text(f"{number} n/a: {reason}", style="dim"))


def _print(block: Block, console: Console) -> None:
    match block:
        case Section():
            console.print()
            _say(console, Text(block.title, style="bold underline"))
            for inner in block.blocks:
                _print(inner, console)
        case Row():
            for inner in block.blocks:
                _print(inner, console)
        case Paragraph():
            _say(console, Text(block.text, style="bold" if block.strong else ""))
        case Status():
            _say(console, Text(block.text, style=STYLE[block.tone] or "bold"))
        case Items():
            for item in block.items:
                print_hanging(console, "- ", _item(item))
        case Code():
            console.print(Text(block.text.rstrip("\n"), style="dim"), highlight=False, soft_wrap=True)
        case Table():
            print_table(block, console)


def _say(console: Console, text: Text) -> None:
    console.print(text, highlight=False)


def print_hanging(console: Console, mark: str | Text, text: Text) -> None:
    """Print a text after a mark, such as a bullet; the text's later lines are indented by the mark's width."""
    before = Text.assemble(mark)
    indent = " " * before.cell_len
    for line in text.wrap(console, max(console.width - len(indent), 1)):
        line.rstrip()
        console.print(Text.assemble(before, line), highlight=False)
        before = Text(indent)


def _item(item: Item) -> Text:
    label = f"{item.label}: " if item.label else ""
    detail = f" ({item.detail})" if item.detail else ""
    return Text.assemble((label, "bold"), (item.text, STYLE[item.tone]), (detail, "dim"))


def _cell(table: Table, cell: Cell) -> Text:
    text = f"{cell.text} [{table.mark(cell)}]" if cell.reason else cell.text
    style = STYLE[cell.tone] or ("bold" if cell.strong or cell.tracker else "")
    return Text("\n").join([Text(text, style=style), *(Text(detail, style="dim") for detail in cell.details)])


def fitting_columns(widths: Sequence[int], keys: int, room: int, gap: int) -> Iterator[list[int]]:
    """Split a table into parts that fit into a line, and yield the column indices of each part.

    Args:
        widths: widths of all columns, characters.
        keys: number of left columns that name the row, and are in every part.
        room: length of a line, characters.
        gap: spaces between two columns.
    """
    part = [*range(keys)]
    for i in range(keys, len(widths)):
        if len(part) > keys and sum(widths[k] + gap for k in [*part, i]) - gap > room:
            yield part
            part = [*range(keys)]
        part.append(i)
    yield part


def _keys(table: Table) -> int:
    """Return the number of left columns that name the row."""
    columns = enumerate(table.columns)
    return next((i for i, column in columns if not column.left and i > 0), len(table.columns))


def _print_record(table: Table, row: Sequence[Cell], console: Console) -> None:
    """Print a row as a list entry, "heading cell; heading cell", for a console too narrow for columns."""
    key = table.key_column
    cells = [(column.heading, _cell(table, cell)) for column, cell in zip(table.columns, row, strict=True)]
    texts = [Text.assemble(f"{heading} ", cell) for i, (heading, cell) in enumerate(cells) if i != key and cell]
    print_hanging(console, "- ", Text.assemble(cells[key][1], ": ", Text("; ").join(texts)))


def _width(table: Table, index: int) -> int:
    texts = [table.columns[index].heading]
    for row in table.rows:
        cell = row[index]
        texts += [cell.text + (" [9]" if cell.reason else ""), *cell.details]
    return min(_WIDEST, max(map(len, texts)))
