"""Trackers with faults that people made, and the sound trackers that the faults are put into.

``bases/NAME.py`` are sound programs with a class ``Tracker``. Each entry of ``faults.yaml`` replaces text of a base.
The class of a program that follows several objects has ``identities = "hidden"``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from trackbench.driving.steppers import ForeignTracker
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.traffic import TrafficDoctor

FOLDER = Path(__file__).parent


class Fault(NamedTuple):
    """An entry of ``faults.yaml``."""

    name: str
    base: str
    source: str
    """Address of an issue, pull request, commit or question that shows that a person made the fault."""
    said: str
    replace: list[dict[str, str]]
    """``old``, which the base has once, and ``new``."""
    accept: list[str]
    """Names that the doctor may give first."""


class Program(NamedTuple):
    """Text of a tracker."""

    name: str
    text: str
    fault: Fault | None = None
    """None of a sound program."""
    lines: frozenset[int] = frozenset()
    """Numbers of the lines that differ from the base, from 1."""

    @property
    def follows_several(self) -> bool:
        """Whether the tracker follows several objects."""
        return re.search(r'^    identities = "hidden"', self.text, re.MULTILINE) is not None

    def write(self, folder: Path) -> Path:
        """Write the text as a module of the program's name; return the file."""
        file = folder / f"{self.name}.py"
        file.write_text(self.text, encoding="utf-8")
        return file


def faults() -> list[Program]:
    """Return the faulty programs."""
    return [with_faults(fault.name, [fault]) for fault in entries().values()]


def bases() -> list[Program]:
    """Return the sound programs."""
    return [Program(file.stem, file.read_text(encoding="utf-8")) for file in sorted((FOLDER / "bases").glob("*.py"))]


@cache
def entries() -> dict[str, Fault]:
    """Return the entries of ``faults.yaml`` by name."""
    read = yaml.safe_load((FOLDER / "faults.yaml").read_text(encoding="utf-8"))
    return {entry["name"]: Fault(**entry) for entry in read}


def with_faults(name: str, chosen: Iterable[Fault]) -> Program:
    """Return the base of some faults with all of them, as a program of a name.

    Raises:
        ValueError: the base does not have one of the replaced pieces exactly once.
    """
    first, *others = chosen
    text = (FOLDER / "bases" / f"{first.base}.py").read_text(encoding="utf-8")
    pieces = [(piece["old"], piece["new"]) for fault in (first, *others) for piece in fault.replace]
    for old, _ in pieces:
        if text.count(old) != 1:
            raise ValueError(f"{name}: {first.base}.py has {text.count(old)} times: {old}")
    made, end, lines = "", 0, set[int]()
    for at, old, new in sorted((text.index(old), old, new) for old, new in pieces):
        made += text[end:at]
        begin = made.count("\n") + 1
        made, end = made + new, at + len(old)
        lines |= set(range(begin, begin + new.count("\n") + 1))
    return Program(name, made + text[end:], first, frozenset(lines))


@cache
def doctor() -> Doctor:
    """Return the doctor of trackers of one object."""
    return Doctor(SENSORS, seed=0)


def examined(program: Program, tracker: Any) -> Examination:
    """Examine the class of a program."""
    if program.follows_several:
        return TrafficDoctor(SENSORS).examine(program.name, partial(ForeignTracker, tracker, 1, several=True))
    return doctor().examine(program.name, tracker)


def is_right(program: Program, examination: Examination) -> bool:
    """Return whether the first finding has an accepted name, or names a line that differs from the base."""
    if program.fault is None or not examination.findings:
        return program.fault is None and examination.healthy
    first = examination.findings[0]
    lines = map(int, re.findall(rf"{program.name}\.py:(\d+)", first.evidence))
    return first.fault in program.fault.accept or not program.lines.isdisjoint(lines)
