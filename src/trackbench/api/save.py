"""Files beside result.json in the folder of a run: pages, recording, and other files of subjects."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path

from trackbench import results
from trackbench.base.subjects import offered, resolve
from trackbench.results import Result


def with_artifacts(result: Result, left_out: Collection[str] = ()) -> tuple[Result, dict[str, Callable[[Path], None]]]:
    """Return the result, listing all files of its folder, and by file name a function that writes the file.

    ``left_out`` names optional files, such as ``recording.rrd``, that are omitted.
    """
    from trackbench.document.html import to_html
    from trackbench.document.markdown import to_markdown
    from trackbench.report.result import result_document

    offers = {file: offer for file, offer in offered("artifacts") if file not in left_out}
    files = ("report.html", "report.md", *offers, *(f"{table}.parquet" for table in result.tables))
    result = result.updated(artifacts={"markdown" if file == "report.md" else Path(file).stem: file for file in files})
    document = result_document(result)
    artifacts: dict[str, Callable[[Path], None]] = {
        "report.html": partial(results.write_file, to_html(document)),
        "report.md": partial(results.write_file, to_markdown(document)),
        **{file: partial(resolve(offer.target), result) for file, offer in offers.items()},
    }
    return result, artifacts
