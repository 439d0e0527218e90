"""Where things are, and the code of the package as syntax."""

import ast
import functools
from pathlib import Path

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
DOCS = ROOT / "docs"
SCENARIOS = ROOT / "scenarios"
PACKAGE = ROOT / "src" / "trackbench"
FILES = sorted(PACKAGE.rglob("*.py"))
"""The modules of the package."""


@functools.cache
def syntax_tree(file: Path) -> ast.Module:
    """A module as syntax; read once."""
    return ast.parse(file.read_text(encoding="utf-8"))
