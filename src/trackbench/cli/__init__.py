"""The command line."""

from __future__ import annotations

import sys

from trackbench.base.process import collect_rarely


def main() -> None:
    """The console script. Exit status: see the README."""
    collect_rarely()
    # The commands take their time to import, in which Ctrl-C is as good as later.
    try:
        from trackbench.cli.commands import main as run
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.exit(130)
    run()


__all__ = ["main"]
