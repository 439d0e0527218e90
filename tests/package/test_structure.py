"""The shape of the package: one name for one type, no folder that holds too much of the code, no growth unnoticed."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from pathlib import Path

import pytest
from tests.support.places import FILES, PACKAGE, ROOT, syntax_tree

#: Largest share of the code's lines in one folder.
LARGEST_SHARE = 0.16
#: Largest number of lines of one file.
LONGEST_FILE = 400
#: Largest number of lines, and of files, of all the code.
MOST_LINES = 95_255
MOST_FILES = 508


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


def test_no_folder_holds_too_much_of_the_code() -> None:
    lines = Counter[str]()
    for file in FILES:
        parts = file.relative_to(PACKAGE).parts
        lines["/".join(parts[: 2 if parts[0] == "subjects" else 1])] += lines_of(file)
    large = {name: count for name, count in lines.items() if count > LARGEST_SHARE * lines.total()}
    assert not large


def test_no_file_is_long() -> None:
    long = {str(file.relative_to(ROOT)): lines_of(file) for file in FILES if lines_of(file) > LONGEST_FILE}
    assert not long, f"split these by subject: a file has at most {LONGEST_FILE} lines"


def test_the_code_does_not_grow_unnoticed() -> None:
    lines = sum(map(lines_of, FILES))
    assert lines <= MOST_LINES, (
        f"{lines} lines in src, {MOST_LINES} at most: merge what is alike and "
        "inline what has one caller. Raise MOST_LINES only for a new capability, in the commit that adds it."
    )
    assert len(FILES) <= MOST_FILES, (
        f"{len(FILES)} files in src, {MOST_FILES} at most: put small modules that are read together into one of 100 to "
        f"{LONGEST_FILE} lines. Raise MOST_FILES only for a new capability, in the commit that adds it."
    )
