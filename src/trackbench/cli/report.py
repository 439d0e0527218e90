"""``trackbench report``"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from trackbench import results
from trackbench.base.errors import InputError, counted
from trackbench.base.subjects import offered, resolve
from trackbench.cli.options import NearestChoice
from trackbench.document.palette import tracker_colours

if TYPE_CHECKING:
    from trackbench.document import Document
    from trackbench.document.files import Format
    from trackbench.report.traffic.export import ExportFormat

#: Of the main file of a format; the other formats have none.
_ENDINGS: dict[Format, str] = {"terminal": ".txt", "html": ".html", "markdown": ".md", "latex": ".tex"}


@click.command("report")
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.option(
    "--format",
    "format",
    type=NearestChoice(["terminal", "html", "markdown", "latex", "csv", "svg", "pdf", "mot", "events"]),
    default="terminal",
    show_default=True,
    help="svg and pdf: every figure; csv: every table. Of runs with hidden identities also mot: MOTChallenge text of "
    "the recorded run, and events: what happened, as CSV.",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="PATH", help="Folder of the files.  [default: RUN]")
def report_command(run: Path, format: Format | ExportFormat, out: Path | None) -> None:
    """Write the report of a saved result in any format.

    RUN is the folder of a run, of several runs, which are compared, or of an examination, or a comparison.json. Nothing
    is run again; of an examination the figures are in its report.html alone.

    \b
    Examples:
      trackbench report results/highway
      trackbench report results/highway --format latex --out paper
      trackbench report results --format html --out page.html
      trackbench report results/traffic --format mot --out exported
    """
    if format == "mot" or format == "events":
        _write(dict(_exported(run, format)), run if out is None else out)
        return
    from trackbench.document.files import files
    from trackbench.document.terminal import print_document

    document = _document(run)
    if format == "terminal" and out is None:
        print_document(document, Console())
        return
    folder, name = _target(run, format, out, document.kind)
    content_of = dict(files(document, format, name))
    if not content_of:
        raise InputError(f"{run} holds nothing to write as {format}", key="--format")
    _write(content_of, folder)


def _exported(run: Path, format: ExportFormat) -> Iterator[tuple[str, Callable[[], bytes]]]:
    from trackbench.report.traffic.export import exported

    return exported(results.Result.load(run), format)


def _write(content_of: Mapping[str, Callable[[], bytes]], folder: Path) -> None:
    results.require_writable(folder)
    for path, content in content_of.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        results.write_bytes(folder / path, content())
    click.echo(f"{folder}/: {_summary(list(content_of))}")


def _document(run: Path) -> Document:
    from trackbench.compare import compare, find, load
    from trackbench.report.comparison.document import document
    from trackbench.report.result import result_document

    for file, document_of in offered("documents"):
        if (run / file).is_file():
            saved: Document = resolve(document_of)(run / file)
            return saved
    if run.suffix == ".json" and run.name != results.SUMMARY:
        return document(load(run))
    found = find(run)
    if len(found.entries) == 1:
        return result_document(found.entries[0].result)
    every = (tracker.name for entry in found.entries for tracker in entry.result.summary.trackers)
    return document(compare([found]), tracker_colours(every), times=True)


def _target(run: Path, format: Format, out: Path | None, name: str) -> tuple[Path, str]:
    """The folder of the files, and the name of the main one without its ending."""
    if out is None:
        return (run if run.is_dir() else run.parent), name
    if out.suffix and out.suffix == _ENDINGS.get(format):
        return out.parent, out.stem
    if out.suffix in (".csv", ".svg", ".pdf") or out.is_file():
        raise InputError(f"{out}: name a folder, for there are several files", key="--out")
    return out, name


def _summary(written: list[str]) -> str:
    folders = [path.partition("/")[0] for path in written if "/" in path]
    counts = [f"{counted(folders.count(name), _kind(name))} in {name}/" for name in dict.fromkeys(folders)]
    return ", ".join([*(path for path in written if "/" not in path), *counts])


def _kind(folder: str) -> str:
    """What is in a folder of a report."""
    return folder.removesuffix("s") if folder.endswith("s") else "file"
