"""The report of an examination, as a document."""

from trackbench.report.examination.document import examination_document

__all__ = ["examination_document"]
