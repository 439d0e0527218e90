"""The page and the example on the Python API run as they are."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import DOCS


def python(code: str, folder: Path) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.docs_pages
def test_the_page_runs_from_top_to_bottom(fenced: Callable[[Path], list[Any]], tmp_path: Path) -> None:
    blocks = [block.text for block in fenced(DOCS / "python.md") if block.language == "python"]
    assert blocks
    python("\n".join(blocks), tmp_path)
    written = {file.name for file in tmp_path.iterdir()}
    assert {"cut_in.html", "errors.pdf", "own.png", "results"} <= written


def test_the_cells_of_the_notebook_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without Jupyter: the code cells in order; what each shows is its last expression."""
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((DOCS / "examples" / "notebook.ipynb").read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    pages = []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            statements = ast.parse("".join(cell["source"])).body
            last = statements[-1]
            if not isinstance(last, ast.Expr):
                exec(compile(ast.Module(statements, []), cell["id"], "exec"), names)
                continue
            exec(compile(ast.Module(statements[:-1], []), cell["id"], "exec"), names)
            shown = eval(compile(ast.Expression(last.value), cell["id"], "eval"), names)
            pages += [shown._repr_html_()] if hasattr(shown, "_repr_html_") else []
    printed = capsys.readouterr().out
    ranking, replay, _, own, _ = pages
    assert "imm_three" in ranking
    assert "class=&quot;replay&quot;" in replay
    assert "mine" in own
    assert "paired over 20 runs" in printed
    assert "False ['" in printed


@pytest.mark.docs_pages
def test_the_page_on_live_scenarios_runs_as_printed(run_page: Callable[[Path, Path], int], tmp_path: Path) -> None:
    shutil.copy(DOCS / "examples" / "agent_sees_tracks.py", tmp_path)
    assert run_page(DOCS / "live.md", tmp_path) == 3
