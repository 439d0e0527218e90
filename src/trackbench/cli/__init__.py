"""The command line."""

from __future__ import annotations

import gc
import os
import sys

from trackbench.base.exit_status import INTERRUPTED
from trackbench.cli import parent


def main() -> None:
    """The console script. Exit status: see the README."""
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
    # The modules and figures of a command are some hundred thousand objects that stay: to look at them at every 700 new
    # ones took a tenth of a short run.
    gc.set_threshold(500_000, 50, 100)
    # The commands take their time to import, in which Ctrl-C is as good as later.
    try:
        from trackbench.cli.commands import run_command_line
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return INTERRUPTED
    return run_command_line()


def _open_missing_streams() -> None:
    """Keep the numbers of closed streams, so that no file that is opened gets one; messages go nowhere."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is this one.
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (as long as the process)


__all__ = ["main"]
