"""The report of a result, whatever kind of run it is of."""

from __future__ import annotations

from collections.abc import Mapping

from trackbench.document import Document, Table
from trackbench.report.run.document import run_document
from trackbench.report.run.tables import ranking
from trackbench.report.traffic.document import ranking as ranking_of_tracks
from trackbench.report.traffic.document import traffic_document
from trackbench.results import Result


def result_document(result: Result, colours: Mapping[str, str] | None = None) -> Document:
    """The report of a run.

    Args:
        result: what was found.
        colours: of every tracker of a batch of scenarios; of those of this one, in its order, unless given.
    """
    make = run_document if result.summary.identities == "known" else traffic_document
    return make(result, colours)


def ranking_table(result: Result) -> Table:
    """Every scored tracker, best first."""
    return (ranking if result.summary.identities == "known" else ranking_of_tracks)(result)
