"""The page docs/doctor-reference.md, as ``python -m trackbench.subjects.doctor.docs`` prints it."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.subjects.doctor.certainty import checks_terms
from trackbench.subjects.doctor.findings import known_faults

_INTRODUCTION = """\
# Faults and checks of the doctor

<!-- Made by `python -m trackbench.subjects.doctor.docs`. Change the checks, not this page. -->

A reference: what [the doctor](doctor.md) can name, and what it asks of a tracker. `trackbench explain NAME` prints
where to look and the fix of a fault, and how a check is made. A check of a drive asks whether the tracker is as near to
its target as it states."""
_DRIVE = "Is the tracker as near to its target as it states ("


def doctor_reference() -> str:
    """Return docs/doctor-reference.md: a table of every fault, and one of every check."""
    return "\n".join(_lines()) + "\n"


def _lines() -> Iterator[str]:
    faults, checks = known_faults(), list(checks_terms())
    yield from (_INTRODUCTION, "", f"## {len(faults)} faults", "")
    yield from ("| fault | what is wrong |", "| --- | --- |")
    yield from (f"| `{name}` | {fault.title} |" for name, fault in faults.items())
    yield from ("", f"## {len(checks)} checks", "", "| check | question |", "| --- | --- |")
    yield from (f"| `{term.name}` | {_question(dict(term.page)['check'])} |" for term in checks)


def _question(check: str) -> str:
    return f"A drive: {check.removeprefix(_DRIVE).removesuffix(')?')}." if check.startswith(_DRIVE) else check


if __name__ == "__main__":
    print(doctor_reference(), end="")
