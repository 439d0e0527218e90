"""What is wrong with a log: its sensors, clocks and truth, estimated from the log alone."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"audit": Offer(f"{__name__}.command:audit_command", "Find what is wrong with a log, and put it right.")},
    api={"LogAudit": f"{__name__}.api:ReportableAudit", "audit": f"{__name__}.api:audit"},
)
