"""Standard output of a command, reserved for its result: prints of plug-ins go to standard error."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TextIO

import click

#: Standard output as it was before ``redirect_prints``; None without redirection.
_stdout: TextIO | None = None


def redirect_prints() -> None:
    """Send all later prints to standard error, except those by ``print_answer``."""
    global _stdout
    if sys.stdout is not None:
        # A character that the encoding lacks becomes a question mark.
        encoding = sys.stdout.encoding
        _stdout = open(os.dup(1), "w", encoding=encoding, errors="replace")  # noqa: SIM115 (as long as the process)
        os.dup2(2, 1)


def answer() -> TextIO | None:
    """Return the standard output with which the command was started; None if it was closed."""
    return _stdout or sys.stdout


def kept_path(path: Path) -> Path:
    """Return the path, or for ``/dev/stdout`` the standard output with which the command was started."""
    return Path(f"/dev/fd/{_stdout.fileno()}") if _stdout is not None and str(path) == "/dev/stdout" else path


def print_answer(text: str, *, nl: bool = True) -> None:
    """Print a part of the command's result on the standard output with which the command was started."""
    click.echo(text, file=answer(), nl=nl)
