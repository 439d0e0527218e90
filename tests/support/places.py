"""Where things are."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
DOCS = ROOT / "docs"
SCENARIOS = ROOT / "scenarios"
PACKAGE = ROOT / "src" / "trackbench"
FILES = sorted(PACKAGE.rglob("*.py"))
"""The modules of the package."""
