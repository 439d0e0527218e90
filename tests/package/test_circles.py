"""No room imports in a circle, not even for a type or inside a function."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import trackbench

PACKAGE = Path(trackbench.__file__).parent
SUBJECTS = PACKAGE / "subjects"
ROOMS = sorted(
    folder
    for above in (PACKAGE, SUBJECTS)
    for folder in above.iterdir()
    if (folder / "__init__.py").is_file() and folder != SUBJECTS
)


def imports(room: Path, top: Path) -> dict[str, set[str]]:
    """The modules of a room that each of its modules imports, anywhere in it."""
    files = {
        ".".join(file.relative_to(top).with_suffix("").parts).removesuffix(".__init__"): file
        for file in room.rglob("*.py")
    }
    graph: dict[str, set[str]] = {}
    for name, file in files.items():
        named = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                named |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module is not None:
                parts = {f"{node.module}.{alias.name}" for alias in node.names}
                named |= {part if part in files else node.module for part in parts}
        graph[name] = {module for module in named if module in files and module != name}
    return graph


def circle(room: Path, top: Path) -> list[str]:
    """Modules of a room that import each other; none where there is no circle."""
    try:
        TopologicalSorter(imports(room, top)).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
def test_a_room_imports_in_no_circle(room: Path) -> None:
    assert not circle(room, PACKAGE.parent)


@pytest.mark.parametrize("line", ["from house.room import a", "import house.room.a", "from house.room.a import A"])
@pytest.mark.parametrize("above", ["", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    ", "def f():\n    "])
def test_a_circle_is_found(tmp_path: Path, above: str, line: str) -> None:
    room = tmp_path / "house" / "room"
    room.mkdir(parents=True)
    (room / "__init__.py").touch()
    (room / "a.py").write_text("from house.room.b import B\nclass A: ...\n")
    (room / "b.py").write_text("class B: ...\n")
    assert not circle(room, tmp_path)
    (room / "b.py").write_text(f"{above}{line}\nclass B: ...\n")
    assert set(circle(room, tmp_path)) == {"house.room.a", "house.room.b"}
