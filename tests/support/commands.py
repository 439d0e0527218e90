"""The command line in this process: a start takes a second less."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from trackbench.cli.commands import run_command_line


def run_command(folder: Path, *arguments: str | Path) -> int:
    """Run ``trackbench`` with arguments in a folder; its status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        # The command line answers a signal, which is no business of the test's process.
        patch.setattr(signal, "signal", lambda *_: None)
        patch.setattr(sys, "argv", ["trackbench", *map(str, arguments)])
        return run_command_line()
