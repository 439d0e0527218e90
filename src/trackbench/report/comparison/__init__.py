"""A comparison as a document, and the files of it."""

from trackbench.report.comparison.document import document
from trackbench.report.comparison.files import batch_files, comparison_files, require_ending

__all__ = ["batch_files", "comparison_files", "document", "require_ending"]
