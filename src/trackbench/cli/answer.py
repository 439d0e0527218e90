"""Standard output of a command: kept for its result, whatever plug-ins and the processes of trackers print."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TextIO

import click

#: Standard output as it was before ``redirect_prints``.
_kept: TextIO | None = None


def redirect_prints() -> None:
    """Let everything but ``print_answer`` that is printed from now on go to standard error."""
    global _kept
    if sys.stdout is not None:
        # A character that the encoding lacks is a question mark, and no reason to lose the rest.
        encoding = sys.stdout.encoding
        _kept = open(os.dup(1), "w", encoding=encoding, errors="replace")  # noqa: SIM115 (as long as the process)
        os.dup2(2, 1)


def answer() -> TextIO | None:
    """Return the standard output with which the command was started; None where that was closed."""
    return _kept or sys.stdout


def kept_path(path: Path) -> Path:
    """Return the file that a path meant when the command was started: ``/dev/stdout`` was standard output then."""
    return Path(f"/dev/fd/{_kept.fileno()}") if _kept is not None and str(path) == "/dev/stdout" else path


def print_answer(text: str, *, nl: bool = True) -> None:
    """Print a part of the command's result."""
    click.echo(text, file=answer(), nl=nl)
