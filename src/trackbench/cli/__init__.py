"""The command line."""

from __future__ import annotations

import sys

from trackbench.base.process import INTERRUPTED, collect_rarely
from trackbench.base.supervised import end
from trackbench.cli import supervisor


def main() -> None:
    """The console script. Exit status: see the README."""
    collect_rarely()
    # Before the commands are imported, so that the process which waits for them is small.
    if supervisor.wanted(sys.argv[1:]):
        supervisor.start_supervised()
    # The commands take their time to import, in which Ctrl-C is as good as later.
    try:
        from trackbench.cli.commands import run_command_line as run
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        end(INTERRUPTED)
    run()


__all__ = ["main"]
