"""The files of a comparison."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from trackbench.compare import Comparison
from trackbench.errors import InputError
from trackbench.report.comparison.document import document
from trackbench.report.document.files import Format, files
from trackbench.report.document.html import to_html
from trackbench.report.document.latex import to_latex
from trackbench.report.document.markdown import to_markdown
from trackbench.report.document.model import Document
from trackbench.results import to_json

ENDINGS = (".md", ".html", ".tex", ".csv", ".json", ".svg", ".pdf")


def require_ending(path: Path, key: str) -> None:
    """Make sure that a file's ending names a format.

    Raises:
        InputError: it does not.
    """
    if path.suffix not in ENDINGS:
        raise InputError(f"{path.name} ends in none of {', '.join(ENDINGS)}", key=key)


def batch_files(comparison: Comparison, folder: Path, colours: Mapping[str, str]) -> Iterator[tuple[Path, bytes]]:
    """A page, the same as Markdown with its figures, and the data; ``colours`` are those of its trackers.

    The Markdown and the data have neither times nor links, so they are the same on every machine and can be kept.
    """
    yield from comparison_files(comparison, folder / "comparison.html", colours)
    yield from comparison_files(comparison, folder / "comparison.json", colours)
    for name, content in files(document(comparison, colours), "markdown", "comparison"):
        yield folder / name, content()


def comparison_files(
    comparison: Comparison, path: Path, colours: Mapping[str, str] | None = None
) -> Iterator[tuple[Path, bytes]]:
    """The file of a comparison in the format of its ending, and what belongs to it.

    Tables and figures that are files of their own are named after it: ``x.csv`` where there is one, else
    ``x-ranking.csv``, and in the folders ``tables/x`` and ``figures/x`` for LaTeX.
    """
    if path.suffix == ".json":
        yield path, to_json(comparison.json()).encode()
    elif path.suffix == ".html":
        page = document(comparison, colours, reports=_reports(comparison, path.parent), times=True)
        yield path, to_html(page).encode()
    elif path.suffix == ".md":
        yield path, to_markdown(document(comparison, colours)).encode()
    elif path.suffix == ".tex":
        yield from _latex(document(comparison, colours), path)
    else:
        formats: dict[str, Format] = {".csv": "csv", ".svg": "svg", ".pdf": "pdf"}
        parts = list(files(document(comparison, colours), formats[path.suffix]))
        for name, content in parts:
            own = "" if len(parts) == 1 else f"-{Path(name).stem}"
            yield path.with_name(f"{path.stem}{own}{path.suffix}"), content()


def _latex(page: Document, path: Path) -> Iterator[tuple[Path, bytes]]:
    folders = {kind: f"{kind}/{path.stem}" for kind in ("tables", "figures")}
    yield path, to_latex(page, **folders).encode()
    for name, content in files(page, "latex"):
        kind, _, file = name.partition("/")
        if kind in folders:
            yield path.parent / folders[kind] / file, content()


def _reports(comparison: Comparison, folder: Path) -> dict[str, str]:
    """Where each result's report is, relative to a folder; those that have none are left out."""
    found = {}
    for label in {result.label for scenario in comparison.scenarios for result in scenario.results}:
        run = Path(label).parent if label.endswith(".json") else Path(label)
        if (run / "report.html").is_file():
            found[label] = Path(os.path.relpath(run / "report.html", folder)).as_posix()
    return found
