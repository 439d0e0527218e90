"""The report of a run, as a document."""

from trackbench.report.run.document import run_document

__all__ = ["run_document"]
