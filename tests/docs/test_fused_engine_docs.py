"""The page on the fused engine does what it says, and its figure is what the engine compiles."""

from __future__ import annotations

import importlib
import importlib.util
import math
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.places import DOCS

from trackbench.base import linalg
from trackbench.engine.arithmetic import ERROR
from trackbench.engine.choice import WORTH_COMPILING
from trackbench.engine.equations import Equations
from trackbench.engine.graph import LARGEST, Untraceable
from trackbench.engine.layout import Input
from trackbench.engine.machine import unavailable
from trackbench.engine.numpy_functions import FUNCTIONS
from trackbench.engine.trace import trace

PAGE = DOCS / "fused-engine.md"
TEXT = PAGE.read_text(encoding="utf-8")
#: What the page calls x, p and dt.
SHAPES = {"x": (4,), "p": (4, 4), "dt": ()}
GIVEN: dict[str, Any] = {"x": np.array([1.2, 0.4, 5.0, 0.3]), "p": np.eye(4) + 0.2, "dt": 0.1}


@pytest.mark.docs_pages
@pytest.mark.skipif(unavailable() is not None, reason="no machine code can be made here")
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 5


def test_the_figure_is_up_to_date() -> None:
    spec = importlib.util.spec_from_file_location("fused_engine_figure", DOCS / "fused_engine_figure.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert script.picture() == script.FILE.read_text(encoding="utf-8")


def between(start: str, end: str) -> str:
    return TEXT.partition(start)[2].partition(end)[0]


def traced(function: Callable[[Any], Any]) -> None:
    inputs = [Input(name, shape, 1, "d") for name, shape in SHAPES.items()]
    ranks = {name: len(shape) for name, shape in SHAPES.items()}
    trace(Equations("formula", lambda given: {"found": function(given)}, ranks), inputs)


def value(formula: str, given: Any) -> Any:
    return eval(formula, {"np": np, "math": math, "linalg": linalg}, dict(given))


@pytest.mark.parametrize(("refused", "instead"), re.findall(r"^\| `(.*)` \| `(.*)` \|$", TEXT, re.MULTILINE))
def test_what_cannot_be_traced_can_be_written_otherwise(refused: str, instead: str) -> None:
    with pytest.raises(Untraceable):
        traced(partial(value, refused))
    traced(partial(value, instead))
    np.testing.assert_allclose(value(instead, GIVEN), value(refused, GIVEN), rtol=1e-14)


def test_the_functions_are_those_of_the_code() -> None:
    listed = between("these functions of NumPy:\n\n  ```text", "```").split()
    assert listed == sorted({function.__name__ for function in FUNCTIONS})


def test_the_numbers_are_those_of_the_code() -> None:
    words = " ".join(TEXT.split())
    assert f"at most {max(ERROR.values())} units in the last place" in words
    assert f"from {WORTH_COMPILING:,} steps of single objects" in words
    assert f"more than {LARGEST:,} operations" in words


def test_a_motion_model_that_is_started_can_be_traced(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cli("new", "motion-model", "to_be_traced").status == 0
    monkeypatch.syspath_prepend(tmp_path)
    model = importlib.import_module("to_be_traced").ToBeTraced(acceleration_sigma_mps2=2, time_constant_s=5)
    for equation in (model.transition, model.jacobian, model.noise_gain):
        traced(lambda given, of=equation: of(given["x"], given["dt"]))
