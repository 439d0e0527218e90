"""Examination of a tracker: it names the tracker's faults, each with its evidence and its fix.

In come a tracker, and the sensors and the observer of its scenario; out go an ``Examination``, a page and a recording.
Read ``examine.py`` first: it makes the checks of ``checks/`` one after the other.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"doctor": Offer(f"{__name__}.command:doctor_command", "Find the faults of a tracker, with evidence.")},
    api={"Examination": f"{__name__}.report:Examination", "doctor": f"{__name__}.api:doctor"},
    examiners={"doctor": f"{__name__}.api:remark"},
    lists={"checks": Offer(f"{__name__}.certainty:listed_checks", "The checks are those of `trackbench doctor`.")},
    terms={name: f"{__name__}.certainty:{name}_terms" for name in ("faults", "checks", "examination")},
)
