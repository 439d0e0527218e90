"""The tests of what a change touches: ``make quick`` runs what ``python -m tests.support.changed [COMMIT]`` prints."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from tests.support.places import ROOT

SOURCE, TESTS = Path("src/trackbench"), Path("tests")


def changed_files(since: str) -> list[Path]:
    """Return the files that differ from a commit, and those that git does not track, relative to the repository."""
    commands = (["git", "diff", "--name-only", since], ["git", "ls-files", "--others", "--exclude-standard"])
    outputs = [
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout for command in commands
    ]
    return [Path(line) for output in outputs for line in output.splitlines()]


def selected_tests(files: Iterable[Path], root: Path = ROOT) -> list[str]:
    """Return the test files of some files, relative to the repository.

    A test file that changed is one. The test of a module has the same name in the folder of the same name. Where there
    is none, the test files that import the module are taken: of its room, else of any room; else all of its room.
    """
    tests: set[Path] = set()
    for file in files:
        if file.is_relative_to(TESTS) and file.match("test_*.py"):
            tests |= {file} if (root / file).exists() else set()
        elif file.is_relative_to(SOURCE) and file.suffix == ".py":
            tests |= _tests_of_module(file.relative_to(SOURCE), root)
    return sorted(str(test) for test in tests)


def _tests_of_module(module: Path, root: Path) -> set[Path]:
    own = TESTS / module.with_name(f"test_{module.name}")
    if (root / own).exists():
        return {own}
    name = ".".join((SOURCE.name, *module.with_suffix("").parts)).removesuffix(".__init__")
    room = root / TESTS / Path(*module.parts[: 2 if module.parts[0] == "subjects" else 1])
    for folder in (room, root / TESTS):
        importing = [file for file in folder.rglob("test_*.py") if name in file.read_text(encoding="utf-8")]
        if importing:
            return {file.relative_to(root) for file in importing}
    return {file.relative_to(root) for file in room.rglob("test_*.py")}


if __name__ == "__main__":
    print(*selected_tests(changed_files(sys.argv[1] if len(sys.argv) > 1 else "HEAD")))
