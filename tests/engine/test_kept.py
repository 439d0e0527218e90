"""Machine code kept on disk, and machines on which there can be none."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.engine import kernels as kernels_module
from trackbench.engine import machine
from trackbench.engine.equations import Equations
from trackbench.engine.kernels import Kernels
from trackbench.engine.machine import KernelCache, Processor

KEY = "0" * 64
X = np.linspace(0.0, 1.0, 20)


def squared(factor: float) -> Equations:
    """Equations of which an edit changes a number."""
    return Equations(f"{factor} x^2", lambda values: {"y": factor * values["x"] * values["x"]}, {"x": 0})


def source_of(equations: Equations, inputs: Any) -> str:
    """The source of equations that are kept as if they were the package's own."""
    return equations.name


@pytest.fixture
def count(kernels: Kernels, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is compiled, of this test on."""
    made: list[str] = []
    compiled = Processor.object_code

    def counted(self: Processor, text: str) -> bytes:
        made.append(text)
        return compiled(self, text)

    monkeypatch.setattr(Processor, "object_code", counted)
    monkeypatch.setattr(kernels_module, "source_key", source_of)
    return made


def run(folder: Path, factor: float = 3.0, processor: str | None = None) -> None:
    """Compute by new kernels, which know of what is kept alone."""
    found = Kernels(Processor(processor), KernelCache(folder))(squared(factor), {"x": X})
    np.testing.assert_array_equal(found["y"], factor * X * X)


def test_what_is_kept_is_not_compiled_again(count: list[str], tmp_path: Path) -> None:
    for _ in range(3):
        run(tmp_path)
    assert len(count) == 1
    assert len(list(tmp_path.iterdir())) == 1


def test_an_edit_of_the_equations_has_its_own(count: list[str], tmp_path: Path) -> None:
    for factor in (3.0, 4.0, 3.0):
        run(tmp_path, factor)
    assert len(count) == len(list(tmp_path.iterdir())) == 2


def test_another_processor_has_its_own(count: list[str], tmp_path: Path) -> None:
    for name in (None, "x86-64", None):
        if name is None or "x86_64" in Processor()._target.triple:
            run(tmp_path, processor=name)
    assert len(count) == len(list(tmp_path.iterdir())) == len({Processor(name).key for name in (None, "x86-64")})


def truncated(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-100])


def of_another(file: Path) -> None:
    other = KernelCache(file.parent)
    other.put(KEY, b"code of something else")
    os.replace(file.parent / f"{KEY}.o", file)


def folder_instead(file: Path) -> None:
    file.unlink()
    file.mkdir()


@pytest.mark.parametrize(
    "damage",
    [truncated, of_another, folder_instead],
    ids=lambda f: f.__name__,
)
def test_a_damaged_file_is_made_again(count: list[str], tmp_path: Path, damage: Callable[[Path], None]) -> None:
    run(tmp_path)
    (file,) = tmp_path.iterdir()
    damage(file)
    run(tmp_path)
    assert len(count) == 2
    run(tmp_path)
    # Nothing can be put in place of a folder.
    assert len(count) == (3 if damage is folder_instead else 2)
    assert [item.name for item in tmp_path.iterdir()] == [file.name]


@pytest.mark.parametrize("where", ["a file", "below a file", "full"])
def test_where_nothing_can_be_written_nothing_is_kept(
    count: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    folder = tmp_path / "kernels"
    if where == "full":

        def full(*_: Any) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("trackbench.base.files.os.replace", full)
    else:
        folder.write_text("no folder")
        folder = folder if where == "a file" else folder / "below"
    run(folder)
    run(folder)
    assert len(count) == 2
    assert where != "full" or not list(folder.iterdir())


def test_without_llvmlite_there_are_no_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    assert machine.unavailable() == "llvmlite is not installed: pip install 'trackbench[fast]'"


def test_a_broken_llvmlite_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    llvm = pytest.importorskip("llvmlite.binding")

    def broken(text: str) -> None:
        raise OSError("libllvmlite.so: cannot open shared object file")

    monkeypatch.setattr(llvm, "parse_assembly", broken)
    assert machine.unavailable() == "llvmlite cannot be loaded: libllvmlite.so: cannot open shared object file"
