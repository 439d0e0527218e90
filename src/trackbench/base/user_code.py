"""Where in the user's code something happened."""

from __future__ import annotations

import os
import re
import sysconfig
import traceback
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple


class Frame(NamedTuple):
    """A call on a stack."""

    file: str
    line: int
    function: str


def place_of(error: BaseException, *, installed: bool = True) -> str | None:
    """The last frame of an error's traceback, or of its cause's, that is the user's code; None where none is.

    Args:
        error: what was raised.
        installed: whether the code of an installed package may be the user's.
    """
    frames = traceback.extract_tb(error.__traceback__)
    place = last_of_user([Frame(frame.filename, frame.lineno or 0, frame.name) for frame in frames], installed)
    return place_of(error.__cause__, installed=installed) if place is None and error.__cause__ is not None else place


def last_of_user(frames: Sequence[Frame], installed: bool = True) -> str | None:
    """File, line and function of the last of some frames that is the user's code; None where none is."""
    paths = sysconfig.get_paths()
    standard: list[str | Path] = [paths["stdlib"], paths["platstdlib"], Path(__file__).resolve().parents[1]]
    packages: list[str | Path] = [paths["purelib"], paths["platlib"]]
    # A tracker may itself be an installed package.
    arrays: list[str | Path] = [Path(place, name) for place in packages for name in ("numpy", "scipy")]
    for others in ([*standard, *packages], [*standard, *arrays])[: 1 + installed]:
        for frame in reversed(frames):
            if not frame.file.startswith("<") and not _below(frame.file, others):
                return f"{_shown(frame.file)}:{frame.line}, in {frame.function}"
    return None


#: A line of what faulthandler writes, the most recent call first.
_DUMPED = re.compile(r'^  File "(.+)", line (\d+) in (.+)$', re.MULTILINE)


def place_in_dump(text: str) -> str | None:
    """As :func:`place_of`, of what Python's faulthandler wrote of a process."""
    frames = [Frame(file, int(line), function) for file, line, function in _DUMPED.findall(text)]
    return last_of_user(frames[::-1])


def _below(file: str, folders: Iterable[str | Path]) -> bool:
    path = Path(os.path.realpath(file))
    return any(path.is_relative_to(os.path.realpath(folder)) for folder in folders)


def _shown(file: str) -> str:
    path = Path(file)
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return file
