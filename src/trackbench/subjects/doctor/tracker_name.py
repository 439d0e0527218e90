"""How ``trackbench doctor`` is told which tracker is meant."""

from __future__ import annotations

import ast
from pathlib import Path

from trackbench.base import files
from trackbench.base.errors import InputError


def require_tracker(named: str) -> None:
    """Make sure that a class is named, not the file that it is in.

    Raises:
        InputError: a Python file is named; with the classes in it.
    """
    if ":" in named or "#" in named:
        return
    file = Path(named) if named.endswith(".py") else Path(f"{named}.py")
    if file.is_file():
        place = "" if file.parent == Path() else f" in the folder {file.parent}"
        raise InputError(f"name the class in it{place}: {' or '.join(_classes(file))}", file=file)


def _classes(file: Path) -> list[str]:
    """The classes of a module as a command names them; nothing in it is run."""
    try:
        module = ast.parse(files.read_bytes(file, files.SCENARIO))
    except (SyntaxError, ValueError):
        return [f"{file.stem}:Class"]
    names = [node.name for node in module.body if isinstance(node, ast.ClassDef)]
    return [f"{file.stem}:{name}" for name in names] or [f"{file.stem}:Class"]
