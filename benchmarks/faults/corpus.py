"""Trackers with the faults that people made, and sound ones that are easily held for faulty.

A set is a folder beside this file: ``bases/NAME.py``, sound programs with a class ``Tracker``; ``faults.yaml``, entries
as :class:`Fault`, each of which replaces some text of a base; ``sound.yaml`` and ``sound/NAME.py``, entries as
:class:`Sound`, which no examination may fault.

The sound programs share ``parts.py``, which they import as ``benchmarks.faults.parts`` from wherever they are written
to. The bases are complete in themselves: what a fault replaces must stand in the base's own file.

The class of a program that follows several objects has ``identities = "hidden"``. An accepted name that the doctor does
not know yet has a comment on its line.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import yaml

SETS = Path(__file__).parent
PARTS = SETS / "parts.py"
if str(SETS.parents[1]) not in sys.path:
    sys.path.append(str(SETS.parents[1]))  # for what the programs import; processes started from this one have it too
KINDS = ("single", "imm", "several", "foreign")


class Fault(NamedTuple):
    """An entry of ``faults.yaml``."""

    name: str
    base: str
    kind: str
    source: str
    """Address of an issue, pull request, commit or question that shows that a person made it."""
    said: str
    replace: list[dict[str, str]]
    """``old``, which the base has once, and ``new``."""
    accept: list[str]
    """What the doctor may call it first."""
    harm: list[float] | None = None
    """As ``harm.py`` measures it: position RMSE (several objects: GOSPA) over that of the base, and mean NEES."""


class Sound(NamedTuple):
    """An entry of ``sound.yaml``."""

    name: str
    file: str
    kalman: bool
    said: str
    source: str


class Program:
    """A tracker's text, with what is known of it."""

    def __init__(self, entry: Fault | Sound, text: str, lines: Iterable[int] = ()):
        self.entry, self.text = entry, text
        self.lines = frozenset(lines)  # those that differ from the base, from 1
        self.module = re.sub(r"\W", "_", entry.name)
        self.reference = f"{self.module}:Tracker"

    @property
    def kind(self) -> str:
        return self.entry.kind if isinstance(self.entry, Fault) else "sound"

    @property
    def accept(self) -> tuple[str, ...]:
        return tuple(self.entry.accept) if isinstance(self.entry, Fault) else ()

    @property
    def whole(self) -> str:
        """The text, with that of the parts where it imports them."""
        imports = "from benchmarks.faults.parts import" in self.text
        return self.text + PARTS.read_text(encoding="utf-8") if imports else self.text

    @property
    def identities(self) -> str:
        return "hidden" if re.search(r'^    identities = "hidden"', self.text, re.MULTILINE) else "known"

    def write(self, folder: Path) -> Path:
        """As the module of its reference."""
        file = folder / f"{self.module}.py"
        file.write_text(self.text, encoding="utf-8")
        return file


def faults(name: str) -> list[Program]:
    """The faulty programs of a set."""
    entries = [Fault(**entry) for entry in _read(name, "faults.yaml")]
    return [Program(entry, *replaced(base(name, entry.base), entry)) for entry in entries]


def sound(name: str) -> list[Program]:
    """The sound programs of a set, without the bases."""
    entries = [Sound(**entry) for entry in _read(name, "sound.yaml")]
    return [Program(entry, (SETS / name / "sound" / entry.file).read_text(encoding="utf-8")) for entry in entries]


def bases(name: str) -> list[Program]:
    """The programs that faults are put into, as sound ones."""
    stems = sorted(file.stem for file in (SETS / name / "bases").glob("*.py"))
    return [Program(Sound(stem, stem, True, "", ""), base(name, stem)) for stem in stems]


def base(name: str, stem: str) -> str:
    """The text of a base."""
    return (SETS / name / "bases" / f"{stem}.py").read_text(encoding="utf-8")


def replaced(text: str, entry: Fault) -> tuple[str, set[int]]:
    """The faulty text, and the lines that differ.

    Raises:
        ValueError: the base does not have one of the pieces exactly once.
    """
    pieces = [(piece["old"], piece["new"]) for piece in entry.replace]
    for old, _ in pieces:
        if text.count(old) != 1:
            raise ValueError(f"{entry.name}: {entry.base}.py has {text.count(old)} times: {old}")
    made, end, lines = "", 0, set[int]()
    for at, old, new in sorted((text.index(old), old, new) for old, new in pieces):
        made += text[end:at]
        first = made.count("\n") + 1
        made, end = made + new, at + len(old)
        lines |= set(range(first, first + new.count("\n") + 1))
    return made + text[end:], lines


def _read(name: str, file: str) -> list[Any]:
    return yaml.safe_load((SETS / name / file).read_text(encoding="utf-8")) or []
