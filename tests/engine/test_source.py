"""Kernels of the package's own equations, found again by their source."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.engine import kernels as engine
from trackbench.engine import layout
from trackbench.engine.equations import Equations, Values
from trackbench.engine.kernels import Kernels
from trackbench.engine.layout import Input
from trackbench.engine.machine import KernelCache, Processor

X = np.linspace(0.0, 1.0, 20)
INPUTS = [Input("x", (), 1, "d")]


def of_package(factor: float, key: Any) -> Equations:
    """Equations that say that they are of the package."""

    def scaled(values: Values) -> Values:
        return {"y": factor * values["x"], "same": factor * values["x"], "positive": values["x"] > 0.5}

    scaled.__module__ = "trackbench.engine.scaled"
    return Equations("scaled", scaled, {"x": 0}, key=key)


@pytest.fixture
def traced(kernels: Kernels, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is traced, of this test on, while the package has a source that stays."""
    made: list[str] = []
    trace = engine.trace

    def counted(equations: Equations, inputs: Any) -> Any:
        made.append(equations.name)
        return trace(equations, inputs)

    monkeypatch.setattr(engine, "trace", counted)
    monkeypatch.setattr(layout, "package_source", lambda: "as it is")
    return made


def run(folder: Path, equations: Equations) -> None:
    """Compute by new kernels, which know of what is kept alone."""
    found = Kernels(Processor(), KernelCache(folder))(equations, {"x": X})
    for name, value in equations.function({"x": X}).items():
        np.testing.assert_array_equal(found[name], value)


def test_equations_of_the_package_are_traced_once(traced: list[str], tmp_path: Path) -> None:
    for _ in range(3):
        run(tmp_path, of_package(2.0, ("scaled", 2.0)))
    assert len(traced) == 1


def test_another_source_is_traced_again(traced: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(tmp_path, of_package(2.0, "scaled"))
    monkeypatch.setattr(layout, "package_source", lambda: "edited")
    run(tmp_path, of_package(3.0, "scaled"))
    assert len(traced) == 2


class Own:
    """A class of someone else."""


@pytest.mark.parametrize("key", [Own, (1, Own), Own(), np.sin, lambda: 0, np.float32(1.0), (None, (frozenset(),))])
def test_what_is_made_for_something_of_others_is_always_traced(traced: list[str], key: Any, tmp_path: Path) -> None:
    assert layout.source_key(of_package(2.0, key), INPUTS) is None
    run(tmp_path, of_package(2.0, key))
    run(tmp_path, of_package(2.0, key))
    assert len(traced) == 2


def test_the_source_of_a_package_that_changes_is_not_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package_source = layout.package_source.__wrapped__
    monkeypatch.setattr(layout, "PACKAGE", tmp_path)
    assert package_source() is None
    (tmp_path / "a.py").write_text("a = 1\n")
    os.utime(tmp_path / "a.py", (1e9, 1e9))
    first = package_source()
    assert first is not None
    (tmp_path / "a.py").write_text("a = 2\n")
    assert package_source() is None
    os.utime(tmp_path / "a.py", (1e9, 1e9))
    assert package_source() not in (None, first)
    # Editors mark a file that is open by such a link.
    (tmp_path / ".#a.py").symlink_to("someone@somewhere")
    assert package_source() is None
