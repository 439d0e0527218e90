"""Files of a recording, of one log or of several; each log is a scene."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, Tag

from trackbench.base.config import LIST, WORD, chosen_by, text_or_list
from trackbench.base.errors import InputError, nearest_choices, shortened_text
from trackbench.truth.base import MAX_SCENES, distinct

FileName = Annotated[str, Field(min_length=1)]
Paths = Annotated[
    Annotated[FileName, Tag(WORD)]
    | Annotated[list[FileName], Field(min_length=1, max_length=MAX_SCENES), AfterValidator(distinct), Tag(LIST)],
    chosen_by(
        text_or_list,
        "write a file, or a list of files, such as [monday.csv, tuesday.csv]",
    ),
]


#: File that marks the folder of a ROS 2 bag.
BAG = "metadata.yaml"


def is_log(path: Path) -> bool:
    """Return whether a path is a file, or the folder of a ROS 2 bag."""
    return path.is_file() or (path / BAG).is_file()


def find_log(path: Paths, folder: Path, key: str) -> Path:
    """Return the file that a scenario names.

    Args:
        path: path of one log in the scenario; environment variables are replaced by their values.
        folder: folder of the scenario, where a relative path is looked up before the working directory.
        key: key of the scenario, for error messages.

    Raises:
        InputError: a variable is not set, or the file does not exist.
    """
    assert isinstance(path, str)
    expanded = Path(os.path.expanduser(os.path.expandvars(path)))
    if unset := re.search(r"\$\{?(\w+)", str(expanded)):
        remedy = "set it, such as to the folder that holds recordings"
        raise InputError(f"the environment variable {unset[1]} is not set; {remedy}", key=key)
    for place in (folder / expanded, expanded):
        if os.path.isdir(place) and not is_log(place):
            raise InputError(f"{expanded} is a folder; name a file", key=key)
        if os.path.exists(place):
            return place
    place = folder / expanded
    names = [entry.name for entry in place.parent.iterdir() if entry.is_file()] if os.path.isdir(place.parent) else []
    hint = f"; {nearest_choices(place.name, names)}" if names else ""
    raise InputError(f"there is no file {shortened_text(str(expanded))}{hint}", key=key)


def log_names(paths: Sequence[str]) -> list[str]:
    """Return a distinct name for each log: the part of its path in which the logs' paths differ, without ending."""
    parts = [Path(path).with_suffix("").parts for path in paths]
    first, last = _common_parts(parts), _common_parts([part[::-1] for part in parts])
    names = ["/".join(part[first : len(part) - last]) for part in parts]
    return names if len({*names}) == len(paths) and all(names) else [*paths]


def _common_parts(parts: Sequence[tuple[str, ...]]) -> int:
    return sum(1 for _ in takewhile(lambda each: len({*each}) == 1, zip(*parts, strict=False)))
