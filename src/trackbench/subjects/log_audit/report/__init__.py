"""The report of an audit of a log, as a document."""

from trackbench.subjects.log_audit.report.document import log_audit_document, log_audit_summary

__all__ = ["log_audit_document", "log_audit_summary"]
