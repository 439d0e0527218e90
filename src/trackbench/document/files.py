"""The files of a document in each format."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar, get_args

from rich.console import Console

from trackbench.base.errors import InputError
from trackbench.document.latex import table_to_latex, to_latex
from trackbench.document.markdown import to_markdown
from trackbench.document.model import Document, Table

Format = Literal["terminal", "html", "markdown", "latex", "csv", "svg", "pdf"]
FORMATS: tuple[Format, ...] = get_args(Format)
#: Columns of a text for a terminal.
TEXT_WIDTH = 80

Page = TypeVar("Page")

_TABLES, _FIGURES = "tables", "figures"


def files(document: Document, format: Format, name: str = "report") -> Iterator[tuple[str, Callable[[], bytes]]]:
    """The files of a format: paths relative to its folder, each with a function that makes the content.

    A figure is drawn when its function is called, and only for a format that shows it.

    Args:
        document: what they say.
        format: one of ``FORMATS``.
        name: that of the main file, where there is one, without its ending.
    """
    if format == "terminal":
        yield f"{name}.txt", lambda: text(document).encode()
    elif format == "html":
        from trackbench.document.html import to_html

        yield f"{name}.html", lambda: to_html(document).encode()
    elif format == "markdown":
        yield f"{name}.md", lambda: to_markdown(document, figures=_FIGURES).encode()
        yield from _figures(document, "svg")
    elif format == "latex":
        yield f"{name}.tex", lambda: to_latex(document, tables=_TABLES, figures=_FIGURES).encode()
        for table in document.tables:
            yield f"{_TABLES}/{table.name}.tex", partial(_encoded, table_to_latex, table)
        yield from _figures(document, "pdf")
    elif format == "csv":
        for table in document.tables:
            yield f"{_TABLES}/{table.name}.csv", partial(_encoded, to_csv, table)
    else:
        yield from _figures(document, format)


def text(document: Document, width: int = TEXT_WIDTH) -> str:
    """The document as plain text."""
    from trackbench.document.terminal import print_document

    output = io.StringIO()
    print_document(document, Console(file=output, width=width, no_color=True, force_terminal=False))
    return output.getvalue()


def _figures(document: Document, ending: Literal["svg", "pdf"]) -> Iterator[tuple[str, Callable[[], bytes]]]:
    from trackbench.document.drawing import pdf_file, svg_file

    for figure in document.figures:
        draw = partial(pdf_file, figure) if ending == "pdf" else partial(_encoded, svg_file, figure)
        yield f"{_FIGURES}/{figure.name}.{ending}", draw


def _encoded(render: Callable[[Page], str], page: Page) -> bytes:
    return render(page).encode()


ENDINGS = (".md", ".html", ".txt", ".tex", ".csv", ".svg", ".pdf")


def require_ending(path: Path, endings: tuple[str, ...] = ENDINGS, key: str | None = None) -> None:
    """Make sure that a file's ending names a format.

    Args:
        path: the file.
        endings: those that do.
        key: the option that names the file, if there is one.

    Raises:
        InputError: it does not.
    """
    if path.suffix not in endings:
        raise InputError(f"{path.name} ends in none of {', '.join(endings)}", key=key)


def files_by_ending(document: Document, path: Path) -> Iterator[tuple[Path, bytes]]:
    """The file of a document in the format of its ending, and what belongs to it.

    Tables and figures that are files of their own are named after it: ``x.csv`` where there is one, else
    ``x-ranking.csv``, and in the folders ``tables/x`` and ``figures/x`` for LaTeX.
    """
    if path.suffix == ".html":
        from trackbench.document.html import to_html

        yield path, to_html(document).encode()
    elif path.suffix == ".md":
        yield path, to_markdown(document).encode()
    elif path.suffix == ".txt":
        yield path, text(document).encode()
    elif path.suffix == ".tex":
        yield from _latex(document, path)
    else:
        formats: dict[str, Format] = {".csv": "csv", ".svg": "svg", ".pdf": "pdf"}
        parts = list(files(document, formats[path.suffix]))
        for name, content in parts:
            own = "" if len(parts) == 1 else f"-{Path(name).stem}"
            yield path.with_name(f"{path.stem}{own}{path.suffix}"), content()


def _latex(document: Document, path: Path) -> Iterator[tuple[Path, bytes]]:
    folders = {kind: f"{kind}/{path.stem}" for kind in ("tables", "figures")}
    yield path, to_latex(document, **folders).encode()
    for name, content in files(document, "latex"):
        kind, _, file = name.partition("/")
        if kind in folders:
            yield path.parent / folders[kind] / file, content()


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
