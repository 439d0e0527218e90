"""A document in the format that the ending of a file names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from trackbench.base.errors import InputError
from trackbench.document.files import Format, files, text
from trackbench.document.html import to_html
from trackbench.document.latex import to_latex
from trackbench.document.markdown import to_markdown
from trackbench.document.model import Document

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
