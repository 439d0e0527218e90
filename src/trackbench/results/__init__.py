"""Result of a run: typed, saved whole or not at all, and loaded again.

The summary and the tables of a run come in, from the runner or from its folder. Pages, recordings and comparisons read
the ``Result``. Read ``result.py`` first.
"""

from trackbench.results.folder import (
    EXAMINATION,
    SUMMARY,
    json_text,
    require_file,
    require_replaceable,
    require_writable,
    save_files,
    write_bytes,
    write_file,
)
from trackbench.results.metric_value import ConditionVerdict, MetricValue, PartVerdict, by_value
from trackbench.results.result import MOST_DRAWN, Difference, Result, difference_table, merged_places
from trackbench.results.scenario_summary import TruthAudit, TruthSummary
from trackbench.results.stored_tables import Tables
from trackbench.results.summary import SCHEMA_VERSION, ExpectationResult, Summary
from trackbench.results.tracker_result import ConditionScores, Failure, FiledRows, Health, TrackerResult

__all__ = [
    "EXAMINATION",
    "MOST_DRAWN",
    "SCHEMA_VERSION",
    "SUMMARY",
    "ConditionScores",
    "ConditionVerdict",
    "Difference",
    "ExpectationResult",
    "Failure",
    "FiledRows",
    "Health",
    "MetricValue",
    "PartVerdict",
    "Result",
    "Summary",
    "Tables",
    "TrackerResult",
    "TruthAudit",
    "TruthSummary",
    "by_value",
    "difference_table",
    "json_text",
    "merged_places",
    "require_file",
    "require_replaceable",
    "require_writable",
    "save_files",
    "write_bytes",
    "write_file",
]
