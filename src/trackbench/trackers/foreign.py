"""Trackers that are programs in another language."""

from __future__ import annotations

import os
import shlex
import shutil
from pathlib import Path
from typing import Annotated

from pydantic import Field

from trackbench.base.config import Config
from trackbench.base.errors import InputError, similar_path_hint


class Command(Config):
    """Command line of a program that reads scans and writes estimates or tracks."""

    command: list[Annotated[str, Field(min_length=1)]] = Field(
        min_length=1,
        max_length=100,
        description="The program and its arguments: [./my_tracker, --q, '2']. No shell reads them. The path of "
        "the program starts in the scenario's folder, where it runs, or in the working directory; a name without / is "
        "looked for on PATH.",
    )

    def __str__(self) -> str:
        return shlex.join(self.command)

    @property
    def name(self) -> str:
        """Name of the program in messages."""
        return self.command[0]

    def resolved(self, folder: Path | None) -> list[str]:
        """Return the command with its program's absolute path.

        Raises:
            InputError: the program does not exist or is not executable.
        """
        return [str(_executable(self.command[0], (folder or Path.cwd()).resolve())), *self.command[1:]]

    def files(self, folder: Path) -> set[Path]:
        """Return the files in ``folder`` that the command names: its program, a script or its data."""
        return {file for name in self.command if (file := _place(name, folder)).is_file()}


def use_of(text: str) -> str | dict[str, object]:
    """Return the value of ``use:`` for a text on the command line; a text that is a path means a program."""
    try:
        words = shlex.split(text)
    except ValueError:
        return text
    if not words or ("/" not in words[0] and len(words) == 1):
        return text
    return {"command": words}


def _place(name: str, folder: Path) -> Path:
    return next((file for file in (folder / name, Path(name).absolute()) if file.is_file()), folder / name)


def _executable(name: str, folder: Path) -> Path:
    if "/" not in name:
        program = shutil.which(name)
        if program is not None:
            return Path(program)
        raise InputError(f"there is no program {name!r} on PATH: a path has a /, such as ./{name}")
    path = _place(name, folder)
    if not path.is_file():
        raise InputError(f"there is no program {path.name!r} in {path.parent}{similar_path_hint(path)}")
    if not os.access(path, os.X_OK):
        raise InputError(f"{path} is not executable: chmod +x makes it so, or name its interpreter before it")
    return path
