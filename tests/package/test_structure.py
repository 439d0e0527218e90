"""The shape of the package: one name for one type, and no long file."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import pytest
from tests.support.places import FILES, PACKAGE, ROOT, syntax_tree

#: Largest number of lines of one file.
LONGEST_FILE = 400


def lines_of(file: Path) -> int:
    return len(file.read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize("kind", [ast.ClassDef, ast.FunctionDef])
def test_no_two_public_names_are_the_same(kind: type[ast.ClassDef | ast.FunctionDef]) -> None:
    places: dict[str, set[str]] = defaultdict(set)
    for file in FILES:
        for node in syntax_tree(file).body:
            if isinstance(node, kind) and not node.name.startswith("_"):
                # Overloads of one function are in one file.
                places[node.name].add(str(file.relative_to(PACKAGE)))
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_no_file_is_long() -> None:
    long = {str(file.relative_to(ROOT)): lines_of(file) for file in FILES if lines_of(file) > LONGEST_FILE}
    assert not long, f"split these by subject: a file has at most {LONGEST_FILE} lines"
