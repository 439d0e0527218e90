"""The list of tests that are slow by their cost names tests that exist, and few enough of them."""

from __future__ import annotations

import ast

from tests.support.places import ROOT
from tests.support.slow_tests import listed


def functions(file: str) -> set[str]:
    """The names of a file's functions."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_every_entry_is_a_function_that_exists() -> None:
    entries = [node_id.partition("[")[0].split("::") for node_id in listed()]
    known = {file: functions(file) for file in {file for file, *_ in entries} if (ROOT / file).exists()}
    assert not [(file, name) for file, *_, name in entries if name not in known.get(file, ())]
