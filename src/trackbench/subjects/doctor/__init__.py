"""Examines a tracker and names its faults."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"doctor": Offer(f"{__name__}.command:doctor_command", "Find the faults of a tracker, with evidence.")},
    api={"Examination": f"{__name__}.report:Examination", "doctor": f"{__name__}.api:doctor"},
    examiners={"doctor": f"{__name__}.api:remark"},
    lists={"checks": Offer(f"{__name__}.certainty:listed_checks", "The checks are those of `trackbench doctor`.")},
    terms={name: f"{__name__}.certainty:{name}_terms" for name in ("faults", "checks", "examination")},
)
