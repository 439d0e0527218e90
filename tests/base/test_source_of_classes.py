"""The text that stands for a class of a notebook or a script changes with its code, and with nothing else."""

from __future__ import annotations

import itertools
import linecache
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from trackbench.base import at_hand

#: A class ``Cell`` in two forms: what is between the bars is replaced by what follows them.
CHANGES = {
    "value": """\
class Cell:
    sigma = «1|2»
    def step(self, scan): return 1
""",
    "constant": """\
class Cell:
    sigma = 1
    def step(self, scan): return «1|2»
""",
    "attribute": """\
class Cell:
    sigma = 1
    def step(self, scan): return self.«a|b»
""",
    "list": """\
class Cell:
    sigma = [«1|2»]
    def step(self, scan): return 1
""",
    "nested const": """\
class Cell:
    sigma = 1
    def step(self, scan): return [x+«1|2» for x in scan]
""",
    "lambda": """\
class Cell:
    f = lambda self: «1|2»
""",
    "static method": """\
class Cell:
    @staticmethod
    def f(): return «1|2»
""",
    "class method": """\
class Cell:
    @classmethod
    def f(c): return «1|2»
""",
    "property": """\
class Cell:
    @property
    def f(c): return «1|2»
""",
    "partial": """\
import functools
class Cell:
    f = functools.partial(max, «1|2»)
""",
    "array": """\
import numpy as np
class Cell:
    f = np.arange(5000)«|*2»
""",
    "default": """\
class Cell:
    def f(self, a=«1|2»): return a
""",
    "keyword default": """\
K=«1|2»
class Cell:
    def f(self, *, a=K): return a
""",
    "global": """\
K=«1|2»
class Cell:
    def f(self): return K
""",
    "helper": """\
def g(): return «1|2»
class Cell:
    def f(self): return g()
""",
    "helper of a helper": """\
def g(): return «1|2»
class Cell:
    def f(self): return [(lambda: g())() for _ in 'a']
""",
    "base": """\
class A:
    def g(self): return «1|2»
class Cell(A):
    pass
""",
    "closure": """\
def make(k):
    class Cell:
        def f(self): return k
    return Cell
Cell=make(«1|2»)
""",
    "inner class": """\
class Cell:
    class In:
        def g(self): return «1|2»
""",
    "set": """\
class Cell:
    s={'a','b','«c|d»'}
""",
    "in set": """\
class Cell:
    def f(self,x): return x in {'a','b','«c|d»'}
""",
    "dataclass": """\
from dataclasses import dataclass
@dataclass
class Cell:
    a: int = «1|2»
""",
    "pydantic": """\
from pydantic import BaseModel
class Cell(BaseModel):
    a: int = «1|2»
""",
    "decorated": """\
import functools
def deco(f):
    @functools.wraps(f)
    def w(*a): return f(*a)
    return w
class Cell:
    @deco
    def f(self): return «1|2»
""",
    "decorator": """\
import functools
def deco(f):
    @functools.wraps(f)
    def w(*a): return f(*a)«|+1»
    return w
class Cell:
    @deco
    def f(self): return 1
""",
    "recursive": """\
class Cell:
    def f(self): return Cell, «1|2»
""",
    "instance": """\
from fractions import Fraction
class Cell:
    a = Fraction(1,«2|3»)
""",
    "own instance": """\
class P:
    def __init__(s,k): s.k=k
class Cell:
    a = P(«1|2»)
""",
    "super": """\
class Cell:
    def __init__(self):
        super().__init__(); self.k=«1|2»
""",
    "metaclass": """\
class M(type):
    def g(c): return «1|2»
class Cell(metaclass=M):
    pass
""",
}
_numbers = itertools.count()


def text_of(source: str, where: str) -> str:
    """The text of the class ``Cell`` of a cell that is run, as ``exec`` and as notebooks do."""
    file = "<string>" if where == "exec" else f"<ipython-input-{next(_numbers)}>"
    if where == "notebook":
        linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file
    space: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(source, file, "exec"), space)
    text = at_hand.source_text(at_hand.reference_to(space["Cell"]))
    assert text
    return text


@pytest.mark.parametrize("where", ["exec", "notebook"])
@pytest.mark.parametrize("name", CHANGES)
def test_a_change_shows_and_another_run_of_the_cell_does_not(name: str, where: str) -> None:
    before, old, new, after = re.split("[«|»]", CHANGES[name])
    first, second = (f"{before}{part}{after}" for part in (old, new))
    assert text_of(first, where) == text_of(first, where)
    assert text_of(first, where) != text_of(second, where)


SCRIPT = """\
import hashlib
from trackbench.base import at_hand

def sha256(cell):
    return hashlib.sha256(at_hand.source_text(at_hand.reference_to(cell)).encode()).hexdigest()

class Cell:
    def step(self, state, scan):
        return {"a", "b", "c"} if state in {"x", "y", "z"} else None
print(sha256(Cell))

class Cell:
    def step(self, state, scan):
        return {"a", "b", "d"} if state in {"x", "y", "z"} else None
print(sha256(Cell))
"""


@pytest.mark.parametrize("by", ["file", "text"])
def test_a_class_that_is_defined_anew_in_a_script_shows(tmp_path: Path, by: str) -> None:
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    call = ["script.py"] if by == "file" else ["-c", SCRIPT]
    done = [
        subprocess.run([sys.executable, *call], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    ]
    assert done[0] == done[1]
    first, second = done[0].split()
    assert first != second
