"""What commands import, as their start waits for it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


def test_a_check_waits_for_the_simulator_alone_and_only_where_the_truth_is_not_stored(
    tiny: Path, monkeypatch: pytest.MonkeyPatch, run_tiny: Callable[..., Any]
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tiny.parent / "cache"))
    unused = {"pandas", "pyarrow", "matplotlib", "rerun", "scipy.stats", "llvmlite"}
    assert "highway_env" in loaded(tiny.parent, "check", "tiny.yaml")
    run_tiny(folder=tiny.parent)
    modules = loaded(tiny.parent, "check", "tiny.yaml")
    assert "trackbench.scenario.check" in modules
    assert not modules & {*unused, "highway_env", "gymnasium"}
