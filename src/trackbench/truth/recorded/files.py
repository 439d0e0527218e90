"""Finding a recorded file, and its text."""

from __future__ import annotations

import os
import re
from pathlib import Path

from trackbench.base import input_files
from trackbench.base.errors import InputError, nearest

_VARIABLE = re.compile(r"\$(\w+|\{[^}]*\})")


def find(path: str, folder: Path, key: str) -> Path:
    """The file that a scenario names.

    Args:
        path: as the scenario gives it; environment variables are filled in.
        folder: the scenario's, where a relative path starts; then the working directory.
        key: the scenario's key, for error messages.

    Raises:
        InputError: a variable is not set, or there is no such file.
    """
    expanded = Path(os.path.expandvars(path)).expanduser()
    unset = _VARIABLE.search(str(expanded))
    if unset is not None:
        name = unset.group(1).strip("{}")
        raise InputError(f"the environment variable {name} is not set; {_meaning(name)}", key=key)
    for place in (folder / expanded, expanded):
        if place.is_file():
            return place
    place = folder / expanded
    if place.is_dir():
        raise InputError(f"{expanded} is a folder; name a file in it", key=key)
    names = [entry.name for entry in place.parent.iterdir()] if place.parent.is_dir() else []
    hint = f"; {nearest(place.name, names)}" if names else ""
    raise InputError(f"there is no file {expanded}{hint}", key=key)


def read_text(file: Path) -> str:
    """The text of a file in UTF-8.

    Raises:
        InputError: it cannot be read, is empty or is not UTF-8.
    """
    raw = input_files.read_bytes(file)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"not UTF-8 text (byte 0x{raw[error.start]:02x})", file=file, line=line) from None
    if not text.strip():
        raise InputError("the file is empty", file=file)
    return text


def _meaning(name: str) -> str:
    if name == "TRACKBENCH_DATA":
        return "it is the folder that holds recordings, such as udacity/obj_pose-laser-radar-synthetic-input.txt"
    return "set it, or write the path without it"
