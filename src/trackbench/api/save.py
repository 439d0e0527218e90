"""The folder of a run: its pages, its recording, its tables."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path

from trackbench import results
from trackbench.base.subjects import offered, resolve
from trackbench.results import Result


def with_artifacts(result: Result, left_out: Collection[str] = ()) -> tuple[Result, dict[str, Callable[[Path], None]]]:
    """Return the result, which names all files of its folder, and what writes those beside its numbers.

    Args:
        result: of the run.
        left_out: the files of subjects that are not written.
    """
    from trackbench.document.html import to_html
    from trackbench.document.markdown import to_markdown
    from trackbench.report.result import result_document

    document = result_document(result)
    pages = {"report.html": to_html(document), "report.md": to_markdown(document)}
    artifacts: dict[str, Callable[[Path], None]] = {
        name: partial(results.write_file, text) for name, text in pages.items()
    }
    for file, offer in offered("artifacts"):
        if file not in left_out:
            artifacts[file] = partial(resolve(offer.target), result)
    files = (*artifacts, *(f"{table}.parquet" for table in result.tables))
    names = {"markdown" if file == "report.md" else Path(file).stem: file for file in files}
    return result.updated(artifacts=names), artifacts
