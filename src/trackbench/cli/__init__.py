"""Command line: reads arguments, calls ``trackbench.api`` or a subject, and prints the result.

Arguments come in; text or JSON on stdout, messages on stderr and an exit status go out. Read ``commands.py`` first.
"""

from __future__ import annotations

import gc
import os
import sys

from trackbench.base.exit_status import INTERRUPTED
from trackbench.cli import parent


def main() -> None:
    """Run the console script, and exit with a status that the README explains."""
    _open_missing_streams()
    # Before the commands are imported, so that the process which waits for them is small.
    if parent.is_wanted(sys.argv[1:]):
        parent.run_in_child(_redirected_command)
    sys.exit(_redirected_command() if "--in-process" in sys.argv else _command())


def _redirected_command() -> int:
    from trackbench.cli.answer import redirect_prints

    redirect_prints()
    return _command()


def _command() -> int:
    # A command has some hundred thousand lasting objects: garbage collection at every 700 new ones took a tenth of the
    # time of a short run.
    gc.set_threshold(500_000, 50, 100)
    # Ctrl-C must also be handled while the commands are imported.
    try:
        from trackbench.cli.commands import run_command_line
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return INTERRUPTED
    return run_command_line()


def _open_missing_streams() -> None:
    """Open the null device for each closed standard stream, so that no other file gets its descriptor."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is this one.
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (as long as the process)


__all__ = ["main"]
