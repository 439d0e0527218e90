"""Where in the user's code something happened."""

from __future__ import annotations

import os
import re
import sysconfig
import traceback
from collections.abc import Sequence
from pathlib import Path
from traceback import FrameSummary


def place_of(error: BaseException, *, installed: bool = True) -> str | None:
    """The last frame of an error's traceback, or of its cause's, that is the user's code; None where none is.

    Args:
        error: what was raised.
        installed: whether the code of an installed package may be the user's.
    """
    place = last_of_user(traceback.extract_tb(error.__traceback__), installed)
    return place_of(error.__cause__, installed=installed) if place is None and error.__cause__ is not None else place


def last_of_user(frames: Sequence[FrameSummary], installed: bool = True) -> str | None:
    """File, line and function of the last of some frames that is the user's code; None where none is."""
    paths = sysconfig.get_paths()
    standard: list[str | Path] = [paths["stdlib"], paths["platstdlib"], Path(__file__).resolve().parents[1]]
    packages: list[str | Path] = [paths["purelib"], paths["platlib"]]
    # A tracker may itself be an installed package.
    arrays: list[str | Path] = [Path(place, name) for place in packages for name in ("numpy", "scipy")]
    for others in ([*standard, *packages], [*standard, *arrays])[: 1 + installed]:
        for frame in reversed(frames):
            file = Path(os.path.realpath(frame.filename))
            is_other = any(file.is_relative_to(os.path.realpath(folder)) for folder in others)
            if not frame.filename.startswith("<") and not is_other:
                return f"{_shown(frame.filename)}:{frame.lineno}, in {frame.name}"
    return None


#: A line of what faulthandler writes, the most recent call first.
_DUMPED = re.compile(r'^  File "(.+)", line (\d+) in (.+)$', re.MULTILINE)


def place_in_dump(text: str) -> str | None:
    """As :func:`place_of`, of what Python's faulthandler wrote of a process."""
    frames = [FrameSummary(file, int(line), function) for file, line, function in _DUMPED.findall(text)]
    return last_of_user(frames[::-1])


def _shown(file: str) -> str:
    path = Path(file)
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return file
