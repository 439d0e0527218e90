"""Places in the user's code, for messages about failures."""

from __future__ import annotations

import os
import re
import sysconfig
import traceback
from collections.abc import Sequence
from pathlib import Path
from traceback import FrameSummary


def place_of(error: BaseException, *, installed: bool = True) -> str | None:
    """Return file, line and function of the last frame in the user's code, as text; None without one.

    The traceback is the error's, or its cause's if the error's has no such frame.


    Args:
        error: raised error.
        installed: whether an installed package may count as the user's code.
    """
    place = last_of_user(traceback.extract_tb(error.__traceback__), installed)
    return place_of(error.__cause__, installed=installed) if place is None and error.__cause__ is not None else place


def last_of_user(frames: Sequence[FrameSummary], installed: bool = True) -> str | None:
    """Return file, line and function of the last frame that is in the user's code; None if there is none."""
    paths = sysconfig.get_paths()
    standard: list[str | Path] = [paths["stdlib"], paths["platstdlib"], Path(__file__).resolve().parents[1]]
    packages: list[str | Path] = [paths["purelib"], paths["platlib"]]
    # The user's tracker may be an installed package.
    arrays: list[str | Path] = [Path(place, name) for place in packages for name in ("numpy", "scipy")]
    for not_user in ([*standard, *packages], [*standard, *arrays])[: 1 + installed]:
        for frame in reversed(frames):
            file = Path(os.path.realpath(frame.filename))
            is_other = any(file.is_relative_to(os.path.realpath(folder)) for folder in not_user)
            if not frame.filename.startswith("<") and not is_other:
                return f"{_shown(frame.filename)}:{frame.lineno}, in {frame.name}"
    return None


#: Line of a dump by Python's faulthandler, which starts with the most recent call.
_DUMPED = re.compile(r'^  File "(.+)", line (\d+) in (.+)$', re.MULTILINE)


def place_in_dump(text: str) -> str | None:
    """Return the last line of the user's code in a dump by Python's faulthandler; None if there is none."""
    frames = [FrameSummary(file, int(line), function) for file, line, function in _DUMPED.findall(text)]
    return last_of_user(frames[::-1])


def _shown(file: str) -> str:
    path = Path(file)
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return file
