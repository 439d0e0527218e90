"""A comparison as a document, and the files of it."""

from trackbench.report.comparison.document import document, without_truth
from trackbench.report.comparison.files import ENDINGS, batch_files, comparison_files

__all__ = ["ENDINGS", "batch_files", "comparison_files", "document", "without_truth"]
