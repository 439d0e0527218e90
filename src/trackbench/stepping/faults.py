"""Why a tracker cannot go on, and where in its code."""

from __future__ import annotations

import os
import re
import sysconfig
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from trackbench.errors import TrackbenchError
from trackbench.trackers.answers import TrackerFault

#: What it gave is no estimate; a calculation failed; it raised anything else; its process died or was ended.
Kind = Literal["answer", "arithmetic", "raised", "died"]
KINDS = get_args(Kind)

#: Characters of a cause.
LONGEST = 1000


class TrackFault(Exception):
    """A tracker cannot go on.

    Args:
        cause: what went wrong, in one line.
        kind: what sort of fault it is.
        place: file, line and function of the tracker's code, where it is known.
        member: number of the member of the batch that it happened to, where it is known.
    """

    def __init__(self, cause: str, kind: Kind, place: str | None = None, member: int | None = None) -> None:
        super().__init__(cause)
        self.cause = cause
        self.kind: Kind = kind
        self.place = place
        self.member = member

    def __str__(self) -> str:
        return self.cause if self.place is None else f"{self.cause} ({self.place})"


def fault_of(error: BaseException, member: int | None = None) -> TrackFault:
    """The fault that an error in a tracker is."""
    if isinstance(error, TrackFault):
        return error
    kind: Kind = "raised"
    if isinstance(error, TrackerFault):
        kind = "answer"
    elif isinstance(error, ArithmeticError):
        kind = "arithmetic"
    return TrackFault(_cause(error), kind, place_of(error), member)


def _cause(error: BaseException) -> str:
    name = type(error).__name__
    try:
        text = str(error)
    except Exception:
        text = ""
    if not isinstance(error, TrackbenchError):
        # An error of a package may explain itself at length.
        text = text.strip().partition("\n")[0]
    text = "".join(letter if letter.isprintable() else " " for letter in text[:LONGEST])
    text = " ".join(text.split())
    if isinstance(error, TrackbenchError | TrackerFault):
        return text or name
    return f"{name}: {text}" if text else name


class _Frame(NamedTuple):
    file: str
    line: int
    function: str


def place_of(error: BaseException, *, installed: bool = True) -> str | None:
    """The last frame of an error's traceback that is the user's code; None where none is.

    Args:
        error: what was raised.
        installed: whether the code of an installed package may be the user's.
    """
    frames = traceback.extract_tb(error.__traceback__)
    return _last_of_user([_Frame(frame.filename, frame.lineno or 0, frame.name) for frame in frames], installed)


#: A line of what faulthandler writes, the most recent call first.
_DUMPED = re.compile(r'^  File "(.+)", line (\d+) in (.+)$', re.MULTILINE)


def place_in_dump(text: str) -> str | None:
    """As ``place_of``, of what Python's faulthandler wrote of a process."""
    frames = [_Frame(file, int(line), function) for file, line, function in _DUMPED.findall(text)]
    return _last_of_user(frames[::-1])


def _last_of_user(frames: list[_Frame], installed: bool = True) -> str | None:
    paths = sysconfig.get_paths()
    bench = Path(__file__).resolve().parents[1]
    standard: list[str | Path] = [paths["stdlib"], paths["platstdlib"], bench]
    packages: list[str | Path] = [paths["purelib"], paths["platlib"]]
    # A tracker may itself be an installed package.
    arrays: list[str | Path] = [Path(place, name) for place in packages for name in ("numpy", "scipy")]
    for others in ([*standard, *packages], [*standard, *arrays])[: 1 + installed]:
        for frame in reversed(frames):
            if not frame.file.startswith("<") and not _below(frame.file, others):
                return f"{_shown(frame.file)}:{frame.line}, in {frame.function}"
    return None


def _below(file: str, folders: Iterable[str | Path]) -> bool:
    path = Path(os.path.realpath(file))
    return any(path.is_relative_to(os.path.realpath(folder)) for folder in folders)


def _shown(file: str) -> str:
    path = Path(file)
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return file
