"""The report of a tuning, as a document."""

from trackbench.subjects.tuning.report.document import tuning_document, tuning_summary

__all__ = ["tuning_document", "tuning_summary"]
