"""Files of a report in each format: HTML, Markdown, LaTeX, CSV and images."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Literal, get_args

from rich.console import Console

from trackbench.base.errors import InputError
from trackbench.document import Document, Table
from trackbench.document.latex import table_to_latex
from trackbench.document.markdown import to_markdown

Format = Literal["terminal", "html", "markdown", "latex", "csv", "svg", "pdf", "png"]
FORMATS: tuple[Format, ...] = get_args(Format)
#: Ending of the main file, for the formats that have one.
MAIN_ENDINGS: dict[Format, str] = {"terminal": ".txt", "html": ".html", "markdown": ".md"}
ENDINGS = (".md", ".html", ".txt", ".tex", ".csv", ".svg", ".pdf", ".png")
#: Characters of a line of the text format.
TEXT_WIDTH = 80


def files(document: Document, format: Format, name: str = "report") -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield the relative path of each file of a document in a format, with a function that returns its content.

    A figure is drawn only when its function is called.

    Args:
        document: the report.
        format: one of ``FORMATS``.
        name: name of the main file, without ending.
    """
    if format in MAIN_ENDINGS:
        yield f"{name}{MAIN_ENDINGS[format]}", lambda: _main_file(document, format, "figures")
    if format == "latex" or format == "csv":
        for table in document.tables:
            yield f"tables/{table.name}.{'tex' if format == 'latex' else format}", partial(_table_file, table, format)
    if format in ("markdown", "svg", "latex", "pdf", "png"):
        from trackbench.document.drawing import figure_file

        ending = {"markdown": "svg", "latex": "pdf"}.get(format, format)
        for figure in document.figures:
            yield f"figures/{figure.name}.{ending}", partial(figure_file, figure, ending)


def _main_file(document: Document, format: Format, figures: str = "") -> bytes:
    """Return the content of the main file; Markdown links figures in the folder ``figures``, none if empty."""
    if format == "html":
        from trackbench.document.html import to_html

        return to_html(document).encode()
    if format == "markdown":
        return to_markdown(document, figures=figures).encode()
    return document_text(document).encode()


def _table_file(table: Table, format: Format) -> bytes:
    return (table_to_latex(table) if format == "latex" else to_csv(table)).encode()


def document_text(document: Document, width: int = TEXT_WIDTH) -> str:
    """Return the document as plain text in lines of ``width`` characters."""
    from trackbench.document.terminal import print_document

    output = io.StringIO()
    print_document(document, Console(file=output, width=width, no_color=True, force_terminal=False))
    return output.getvalue()


def require_ending(path: Path, endings: tuple[str, ...] = ENDINGS, key: str | None = None) -> None:
    """Raise an error unless a file's ending names a format.

    Args:
        path: the file.
        endings: allowed endings.
        key: option that names the file, for the error message.

    Raises:
        InputError: the ending names no format.
    """
    if path.suffix not in endings:
        raise InputError(f"{path.name} ends in none of {', '.join(endings)}", key=key)


def files_by_ending(document: Document, path: Path) -> Iterator[tuple[Path, bytes]]:
    """Yield the files of a document in the format of the path's ending, with their contents.

    If each table or figure is a file, a single one is ``x.csv``; several are ``x-ranking.csv`` and so on.
    """
    formats: dict[str, Format] = {ending: format for format, ending in MAIN_ENDINGS.items()}
    formats |= {".tex": "latex", ".csv": "csv", ".svg": "svg", ".pdf": "pdf", ".png": "png"}
    format = formats[path.suffix]
    if format in MAIN_ENDINGS:
        yield path, _main_file(document, format)
    else:
        parts = [(name, content) for name, content in files(document, format) if name.endswith(path.suffix)]
        for name, content in parts:
            suffix = "" if len(parts) == 1 else f"-{Path(name).stem}"
            yield path.with_name(f"{path.stem}{suffix}{path.suffix}"), content()


_PLAIN = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " "})


def to_csv(table: Table) -> str:
    """Return a table as CSV; the small print of a column is a column of its own beside it."""
    # Pandas is slow to import.
    import pandas

    columns: dict[str, list[str]] = {}
    for index, column in enumerate(table.columns):
        cells = [row[index] for row in table.rows]
        columns[column.heading] = [cell.text for cell in cells]
        if any(cell.details for cell in cells):
            columns[f"{column.heading}: {column.details}"] = ["; ".join(cell.details) for cell in cells]
    plain = {name.translate(_PLAIN): [text.translate(_PLAIN) for text in texts] for name, texts in columns.items()}
    return str(pandas.DataFrame(plain).to_csv(index=False))
