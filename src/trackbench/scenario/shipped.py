"""Scenarios that come with the package, found by names such as ``highway`` or ``scripted/own_model``."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from trackbench.base.errors import InputError, did_you_mean, similar_names

FOLDER = Path(__file__).parents[1] / "scenarios"
#: Pattern of the endings ``.yaml`` and ``.yml``.
PATTERN = "*.y*ml"


def shipped() -> dict[str, Path]:
    """Return the file of each scenario in the package, by name: its path in the folder of scenarios, without ending."""
    return {_name(file): file for file in sorted(FOLDER.rglob(PATTERN))}


def find_scenario(named: Path | str) -> Path:
    """Return the file or folder that is meant by a path, or by a name of what the package ships.

    An existing path has precedence, unless it is a folder without scenarios and a scenario has its name.

    Raises:
        InputError: there is no such path or name; the message proposes the nearest name.
    """
    path = Path(named)
    is_folder = os.path.isdir(path)
    if os.path.exists(path) and (not is_folder or any(path.glob(PATTERN))):
        return path
    name, files = path.as_posix(), shipped()
    if name in files:
        return files[name]
    if is_folder:
        return path
    if any(path_name.startswith(f"{name}/") for path_name in files):
        return FOLDER / path
    entries = path.parent.iterdir() if os.path.isdir(path.parent) else ()
    beside = {entry.stem: str(entry) for entry in entries if entry.match(PATTERN) or any(entry.glob(PATTERN))}
    # Compared without the endings, which make all names similar.
    choices = {each.rpartition("/")[2]: each for each in files} | beside
    near = did_you_mean([choices[stem] for stem in similar_names(path.stem, choices, 0.6)[:1]])
    hint = near or "`trackbench list scenarios` shows those that come with trackbench"
    raise InputError(f"there is no such file; {hint}", file=path)


def files_of_scenarios(named: Iterable[Path | str]) -> Iterator[Path]:
    """Yield the file of each scenario among ``named``, and all scenario files in each folder among them.

    Raises:
        InputError: there is no such file or folder, or no scenario in it.
    """
    for item in named:
        path = find_scenario(item)
        if not path.is_dir():
            yield path
            continue
        inside = sorted(path.glob(PATTERN))
        if not inside:
            raise InputError("there is no scenario file (*.yaml) in this folder", file=path)
        yield from inside


def is_shipped(file: Path) -> bool:
    """Return whether a scenario's file comes with the package."""
    return file.is_relative_to(FOLDER)


def shown_name(file: Path) -> str:
    """Return a scenario's file as a user names it: the shipped name, or the path."""
    return _name(file) if is_shipped(file) else str(file)


def _name(file: Path) -> str:
    return file.relative_to(FOLDER).with_suffix("").as_posix()
