"""The folder that a run leaves: result, tables, reports, recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from trackbench import results
from trackbench.base.subjects import offered, resolve
from trackbench.base.types import Progress
from trackbench.results import Result

if TYPE_CHECKING:
    from trackbench.compare import Comparison

Writer = Callable[[Path], None]


def pages(result: Result, colours: Mapping[str, str]) -> dict[str, str]:
    """The report of a run, by the name of the file.

    Args:
        result: of the run.
        colours: of its trackers.
    """
    from trackbench.document.html import to_html
    from trackbench.document.markdown import to_markdown
    from trackbench.report.result import result_document

    document = result_document(result, colours)
    return {"report.html": to_html(document), "report.md": to_markdown(document)}


def save(
    result: Result,
    folder: Path,
    pages: Mapping[str, str],
    progress: Progress,
    colours: Mapping[str, str],
    *,
    recording: bool = True,
) -> Result:
    """Write the folder of a run with everything that is in it.

    Args:
        result: of the run.
        folder: its name; an earlier result under it is replaced.
        pages: the report, by the name of the file.
        progress: called with the number of files written and of all.
        colours: of its trackers.
        recording: whether the Rerun recording is among them.

    Returns:
        The result, which names the files.

    Raises:
        TrackbenchError: the folder cannot be written; nothing is left under its name.
    """
    artifacts: dict[str, Writer] = {name: partial(results.write_file, text) for name, text in pages.items()}
    if recording:
        artifacts |= {file: partial(resolve(write), result, colours=colours) for file, write in offered("artifacts")}
    files = (*artifacts, *(f"{table}.parquet" for table in result.tables))
    result = result.updated(artifacts={"markdown" if file == "report.md" else Path(file).stem: file for file in files})
    result.save(folder, _counted(artifacts, progress))
    return result


def save_comparison(found: Sequence[Result], out: Path, colours: Mapping[str, str]) -> Comparison:
    """Write the comparison of several scenarios beside their folders, and return it.

    Raises:
        TrackbenchError: a file cannot be written.
    """
    from trackbench.compare import compare, results_in
    from trackbench.report.comparison import batch_files

    comparison = compare([results_in(out, found)])
    for file, content in batch_files(comparison, out, colours):
        results.write_bytes(file, content)
    return comparison


def _counted(artifacts: Mapping[str, Writer], progress: Progress) -> dict[str, Writer]:
    """The same writers, each of which says which of them it is."""

    def write(number: int, writer: Writer, path: Path) -> None:
        progress(number, len(artifacts))
        writer(path)

    return {name: partial(write, number, writer) for number, (name, writer) in enumerate(artifacts.items())}
