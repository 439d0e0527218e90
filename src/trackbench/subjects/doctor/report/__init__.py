"""The report of an examination, as a document."""

from trackbench.subjects.doctor.report.document import examination_document

__all__ = ["examination_document"]
