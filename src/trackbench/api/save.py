"""The folder of a run: its pages, its recording, its tables."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path

from trackbench import results
from trackbench.base.subjects import offered, resolve
from trackbench.results import Result


def pages(result: Result) -> dict[str, str]:
    """The report of a run, by the name of the file."""
    from trackbench.document.html import to_html
    from trackbench.document.markdown import to_markdown
    from trackbench.report.result import result_document

    document = result_document(result)
    return {"report.html": to_html(document), "report.md": to_markdown(document)}


def save(result: Result, folder: Path, pages: Mapping[str, str], left_out: Collection[str]) -> Result:
    """Write the folder of a run with everything that is in it.

    Args:
        result: of the run.
        folder: its name; an earlier result under it is replaced.
        pages: the report, by the name of the file.
        left_out: the files of subjects that are not written.

    Returns:
        The result, which names the files.

    Raises:
        TrackbenchError: the folder cannot be written; nothing is left under its name.
    """
    result, artifacts = with_artifacts(result, pages, left_out)
    result.save(folder, artifacts)
    return result


def with_artifacts(
    result: Result, pages: Mapping[str, str], left_out: Collection[str] = ()
) -> tuple[Result, dict[str, Callable[[Path], None]]]:
    """The result, which names all files of its folder, and what writes those beside its numbers.

    Args:
        result: of the run.
        pages: the report, by the name of the file.
        left_out: the files of subjects that are not written.
    """
    artifacts: dict[str, Callable[[Path], None]] = {
        name: partial(results.write_file, text) for name, text in pages.items()
    }
    for file, offer in offered("artifacts"):
        if file not in left_out:
            artifacts[file] = partial(resolve(offer.target), result)
    files = (*artifacts, *(f"{table}.parquet" for table in result.tables))
    return result.updated(
        artifacts={"markdown" if file == "report.md" else Path(file).stem: file for file in files}
    ), artifacts
