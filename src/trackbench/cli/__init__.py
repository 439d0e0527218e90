"""The command line."""

from trackbench.cli.main import main

__all__ = ["main"]
