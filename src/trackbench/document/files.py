"""The files of a document in each format."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from functools import partial
from typing import Literal, TypeVar, get_args

from rich.console import Console

from trackbench.document.model import Document

Format = Literal["terminal", "html", "markdown", "latex", "csv", "svg", "pdf"]
FORMATS: tuple[Format, ...] = get_args(Format)
#: Columns of a text for a terminal.
TEXT_WIDTH = 80

Part = TypeVar("Part")

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
        from trackbench.document.markdown import to_markdown

        yield f"{name}.md", lambda: to_markdown(document, figures=_FIGURES).encode()
        yield from _figures(document, "svg")
    elif format == "latex":
        from trackbench.document.latex import table_to_latex, to_latex

        yield f"{name}.tex", lambda: to_latex(document, tables=_TABLES, figures=_FIGURES).encode()
        for table in document.tables:
            yield f"{_TABLES}/{table.name}.tex", partial(_encoded, table_to_latex, table)
        yield from _figures(document, "pdf")
    elif format == "csv":
        from trackbench.document.csv import to_csv

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


def _encoded(render: Callable[[Part], str], part: Part) -> bytes:
    return render(part).encode()
