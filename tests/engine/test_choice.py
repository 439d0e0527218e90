"""Which engine computes, as a user asks for it and as a result says it."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from trackbench.engine import choice
from trackbench.engine.choice import choose_engine
from trackbench.engine.equations import EngineUsed
from trackbench.runner.loop import run_block
from trackbench.runner.work import work_of
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.trackers.filtered import FilterTracker

Cli = Callable[..., Any]

NO_LLVMLITE = "engine: the fused engine cannot be used: llvmlite is not installed: pip install 'trackbench[fast]'"
HIDDEN = """\
name: hidden
truth:
  source: scripted
  duration_s: 1
  rate_hz: 10
  objects: {car: {start: {x: 40, vx_mps: 5}}, other: {start: {x: 30, y: 20, vx_mps: 8}}}
sensing: {identities: hidden}
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15, max_range_m: 100}
trackers:
  gnn: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn}}
monte_carlo: {runs: 2, seed: 7}
"""


@pytest.fixture
def without_llvmlite(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("llvmlite", "llvmlite.binding"):
        monkeypatch.setitem(sys.modules, name, None)


@pytest.fixture
def with_llvmlite() -> None:
    pytest.importorskip("llvmlite")


@pytest.fixture
def ekf_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine leaves some steps of a filter to NumPy."""
    used = EngineUsed("fused and numpy", "a branch on data went another way for 3 of 8 lanes")
    monkeypatch.setattr(FilterTracker, "engine_used", used)


def result_of(tmp_path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((tmp_path / "results" / "tiny" / "result.json").read_text(encoding="utf-8"))
    return found


def said(error: str) -> list[str]:
    """What --verbose said, without the times."""
    return [re.sub(r"^ *\d+ ms  ", "", line) for line in error.splitlines() if " ms  " in line]


@pytest.mark.usefixtures("without_llvmlite")
@pytest.mark.parametrize("command", [("run", "tiny.yaml"), ("tune", "tiny.yaml", "--trackers", "ekf")])
def test_without_llvmlite_the_fused_engine_is_refused_in_one_line(
    cli: Cli, tiny: Path, command: tuple[str, ...]
) -> None:
    done = cli(*command, "--engine", "fused")
    assert done.status == 2
    assert done.err.strip() == NO_LLVMLITE
    assert [file.name for file in tiny.parent.iterdir()] == ["tiny.yaml"]


@pytest.mark.usefixtures("without_llvmlite")
def test_auto_computes_by_numpy_without_llvmlite_and_says_so_if_asked(
    cli: Cli, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(choice, "WORTH_COMPILING", 1)
    done = cli("run", "tiny.yaml", "--no-recording", "--verbose")
    assert done.status == 0, done.err
    assert "computed by NumPy: llvmlite is not installed: pip install 'trackbench[fast]'" in said(done.err)
    found = result_of(tmp_path)
    assert found["engine"] == "numpy"
    assert "--engine" not in found["command"]


@pytest.mark.usefixtures("with_llvmlite")
def test_auto_takes_the_fused_engine_where_there_is_work_enough() -> None:
    assert choose_engine("auto", choice.WORTH_COMPILING - 1) == "numpy"
    assert choose_engine("auto", choice.WORTH_COMPILING) == "fused"
    assert choose_engine("numpy", 10**9) == "numpy"
    assert choose_engine("fused", 1) == "fused"


def test_a_result_names_the_engine_that_was_asked_for(cli: Cli, tiny: Path, tmp_path: Path) -> None:
    done = cli("run", "tiny.yaml", "--no-recording", "--engine", "numpy")
    assert done.status == 0, done.err
    found = result_of(tmp_path)
    assert found["engine"] == "numpy"
    assert found["command"].endswith("--engine numpy")
    assert {tracker["name"]: tracker["engine"] for tracker in found["trackers"]} == {"raw": None, "ekf": "numpy"}
    report = (tmp_path / "results" / "tiny" / "report.md").read_text(encoding="utf-8")
    assert re.search(r"rerun-sdk [\d.]+; numpy engine$", report, re.M)


@pytest.mark.usefixtures("with_llvmlite")
def test_a_tracker_that_is_computed_by_both_is_named_and_told(
    cli: Cli, tiny: Path, tmp_path: Path, ekf_in_part: None
) -> None:
    done = cli("run", "tiny.yaml", "--no-recording", "--engine", "fused", "--verbose")
    assert done.status == 0, done.err
    why = "a branch on data went another way for 3 of 8 lanes"
    assert f"tiny: ekf was computed by NumPy in part: {why}" in said(done.err)
    found = result_of(tmp_path)
    assert found["engine"] == "fused and numpy"
    report = (tmp_path / "results" / "tiny" / "report.md").read_text(encoding="utf-8")
    assert re.search(r"; fused and numpy engines$", report, re.M)


@pytest.mark.parametrize("text", [None, HIDDEN])
def test_a_worker_without_the_fused_engine_computes_by_numpy_and_says_so(
    tiny: Path, monkeypatch: pytest.MonkeyPatch, text: str | None
) -> None:
    if text is not None:
        tiny.write_text(text, encoding="utf-8")
    loaded = load_scenario(tiny)
    sent = replace(work_of(loaded, truths_of(loaded)), engine="fused")
    for name in ("llvmlite", "llvmlite.binding"):
        monkeypatch.setitem(sys.modules, name, None)
    block = run_block(sent, sent.pieces()[0])
    reason = "llvmlite is not installed: pip install 'trackbench[fast]'"
    assert set(block.engines.values()) == {EngineUsed("numpy", reason)}
