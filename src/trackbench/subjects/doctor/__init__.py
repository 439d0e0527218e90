"""Examines a tracker and names its faults."""

from trackbench.base.subjects import Command, Subject

SUBJECT = Subject(
    commands={"doctor": Command(f"{__name__}.command:doctor_command", "Find the faults of a tracker, with evidence.")},
    api={"Examination": f"{__name__}.report:Examination", "doctor": f"{__name__}.api:doctor"},
    lists={"checks": f"{__name__}.findings:listed_checks"},
    documents={"examination.json": f"{__name__}.report:saved_document"},
)
