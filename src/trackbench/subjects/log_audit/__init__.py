"""Audits of recorded logs: faults of sensors, clocks and ground truth, estimated from the log alone.

A scenario with recorded truth and measurements comes in; findings, and the scenario with their corrections, go out.
Read ``audit.py`` first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"audit": Offer(f"{__name__}.command:audit_command", "Find what is wrong with a log, and put it right.")},
    api={"LogAudit": f"{__name__}.api:ReportableAudit", "audit": f"{__name__}.api:audit"},
)
