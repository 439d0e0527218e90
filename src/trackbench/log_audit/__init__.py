"""What is wrong with a log: its sensors, clocks and truth, estimated from the log alone."""

from trackbench.log_audit.audit import LogAudit, audit_log

__all__ = ["LogAudit", "audit_log"]
