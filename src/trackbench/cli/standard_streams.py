"""Standard input, output and error, where the shell did not give all of them or what is written has no room."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from trackbench.base.errors import InputError, OutputError

#: Characters of the tables.
PRINTED = "±²µ°é"


def open_missing() -> None:
    """Keep the numbers of closed streams, so that no file that is opened gets one; messages go nowhere."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is this one.
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (as long as the process)


def require_stdout() -> None:
    """Make sure, before any work, that its result can be printed.

    Raises:
        OutputError: standard output is closed.
        InputError: it has an encoding that lacks characters of a table.
    """
    if sys.stdout is None:
        raise OutputError("standard output is closed; to print nothing, send it to /dev/null")
    try:
        PRINTED.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        problem = f"standard output is written as {sys.stdout.encoding}, which lacks characters of the tables"
        raise InputError(f"{problem}; set PYTHONIOENCODING=utf-8") from None


def flush() -> None:
    """Write what is still held back.

    Raises:
        OSError: standard output takes no more.
    """
    if sys.stdout is not None:
        sys.stdout.flush()


def say(text: str) -> None:
    """A message on stderr, if that can be written."""
    with suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)


def abandon() -> None:
    """Let what cannot be written go nowhere, so that the interpreter does not try it again as it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError, AttributeError):
            with suppress(OSError, ValueError, AttributeError):
                os.dup2(nowhere, stream.fileno())
