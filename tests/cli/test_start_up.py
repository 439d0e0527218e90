"""What commands import, as their start waits for it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

#: Packages that take .1 s or more to import.
SLOW = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "rerun", "pydantic", "rich", "gymnasium", "llvmlite")


def loaded(folder: Path, *arguments: str) -> set[str]:
    """The modules that a command imports."""
    code = (
        "import atexit, json, sys; from trackbench.cli import main; out = open('loaded.json', 'w'); "
        "atexit.register(lambda: (json.dump(list(sys.modules), out), out.flush())); "
        f"sys.argv = {['trackbench', *arguments]!r}; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(json.loads((folder / "loaded.json").read_text(encoding="utf-8")))


@pytest.mark.parametrize("option", ["--version", "--help"])
def test_help_and_version_wait_for_no_library(tmp_path: Path, option: str) -> None:
    assert not loaded(tmp_path, option).intersection(SLOW)
