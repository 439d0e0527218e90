"""The floors of the house, and its figure."""

from __future__ import annotations

import importlib.util
import subprocess
from types import ModuleType

import pytest
from tests.support.places import DOCS, ROOT

#: Packages below the command line stand on so many floors at most.
MOST_FLOORS = 12


@pytest.fixture(scope="module")
def figure() -> ModuleType:
    spec = importlib.util.spec_from_file_location("house_figure", DOCS / "house_figure.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_core_below_the_command_line_has_few_floors(figure: ModuleType) -> None:
    floors = figure.floors(figure.imports_of_packages())
    assert floors["base"] == 1
    assert floors["cli"] - 1 <= MOST_FLOORS


def test_the_figure_shows_every_package(figure: ModuleType) -> None:
    drawn = figure.FILE.read_text(encoding="utf-8")
    for package in figure.imports_of_packages():
        assert f">{package.removeprefix('subjects.')}<" in drawn, f"{package}: run python docs/house_figure.py"


def test_every_package_of_the_core_is_described(figure: ModuleType) -> None:
    page = (DOCS / "developing.md").read_text(encoding="utf-8")
    core = [package for package in figure.imports_of_packages() if "." not in package and package != "testing"]
    assert [package for package in core if f"`{package}`" not in page] == []


def test_make_reads_its_file() -> None:
    done = subprocess.run(["make", "--dry-run", "help"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
