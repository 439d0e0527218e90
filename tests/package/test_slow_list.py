"""The list of tests that are slow by their cost names tests that exist, and few enough of them."""

from __future__ import annotations

import ast

from tests.support.places import ROOT
from tests.support.slow_tests import LARGEST_NUMBER, PARTS, costliest, listed, part


def functions(file: str) -> set[str]:
    """The names of a file's functions."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_every_entry_is_a_function_that_exists() -> None:
    entries = [node_id.partition("[")[0].split("::") for node_id in listed()]
    known = {file: functions(file) for file in {file for file, *_ in entries} if (ROOT / file).exists()}
    assert not [(file, name) for file, *_, name in entries if name not in known.get(file, ())]


def test_no_more_than_a_tenth() -> None:
    assert 0 < len(listed()) <= LARGEST_NUMBER


def test_every_part_has_its_share() -> None:
    sizes = [sum(part(node_id) == number for node_id in listed()) for number in range(PARTS)]
    assert sum(sizes) == len(listed())
    assert min(sizes) > 0.6 * len(listed()) / PARTS


def test_the_costlier_half_of_a_file() -> None:
    log = """\
[gw0] [  1%] PASSED tests/a.py::test_a[x y]
tests/a.py::test_b
[gw1] [  2%] PASSED tests/a.py::test_b
PASSED tests/a.py::test_c
PASSED tests/b.py::test_alone
  9.00s call     tests/b.py::test_alone
  1.00s call     tests/a.py::test_b
  0.70s setup    tests/a.py::test_a[x y]
  0.60s call     tests/a.py::test_a[x y]
"""
    assert costliest(log) == ["tests/a.py::test_a[x y]"]
