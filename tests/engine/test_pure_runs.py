"""Runs with a user's motion model that says ``pure = True``: its kernels are compared with NumPy in the first block."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

import trackbench as tb
from trackbench.base.types import Array
from trackbench.engine import kernels as kernels_module
from trackbench.engine.choice import Engine
from trackbench.runner import work

ENGINES: tuple[Engine, ...] = ("fused", "numpy")
pytestmark = pytest.mark.usefixtures("kernels")
SCENARIO = """
name: mine
truth:
  source: scripted
  duration_s: 4
  rate_hz: 10
  objects:
    near: {start: {x: 10, y: -20, speed_mps: 12, course_deg: 45}}
    far: {start: {x: 45, y: -20, speed_mps: 12, course_deg: 45}}
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}
trackers:
  mine: {filter: ekf, motion: "MODULE:Mine", acceleration_sigma_mps2: 0.5}
monte_carlo: {runs: 20, seed: 3}
"""
MODULE = """
from typing import ClassVar
import numpy as np
from trackbench.models.motion import ConstantVelocity

class Mine(ConstantVelocity):
    linear: ClassVar[bool] = False
    pure = True

    def transition(self, x, dt):
        BODY
        return super().transition(x, dt)
"""
#: It is traced as what NumPy does not compute.
BRANCH = "if np.all(x[0] > 40): x = 1.01 * x"


@pytest.fixture
def scenario(tmp_path: Path, write_module: Callable[[Path, str], str]) -> Callable[..., Path]:
    def write(body: str = "pass") -> Path:
        name = write_module(tmp_path, MODULE.replace("BODY", body))
        (tmp_path / "mine.yaml").write_text(SCENARIO.replace("MODULE", name))
        return tmp_path / "mine.yaml"

    return write


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is compared, a step or something else, in small blocks of runs."""
    names: list[str] = []

    def agree(outputs: Mapping[str, Array], expected: Mapping[str, Array]) -> bool:
        names.append("step" if {"innovation", "cartesian"} <= outputs.keys() else "other")
        return agree_of_kernels(outputs, expected)

    agree_of_kernels = kernels_module.agree
    monkeypatch.setattr(kernels_module, "agree", agree)
    monkeypatch.setattr(work, "BATCH_SIZE", 20)
    return names


def mine(file: Path, engine: Engine) -> dict[str, Any]:
    """The tracker in the result, without its times."""
    (tracker,) = tb.run(file, engine=engine, workers=1).json()["trackers"]
    result: dict[str, Any] = tracker
    del result["metrics"]["step_time"]
    return result


def position_error(tracker: dict[str, Any]) -> Any:
    return tracker["metrics"]["position_rmse"]["value"]


def test_a_pure_model_is_compiled_and_compared_in_the_first_block(
    scenario: Callable[..., Path], compared: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    """At each step of it, and in no other block."""
    file = scenario()
    fused, by_numpy = (mine(file, engine) for engine in ENGINES)
    assert fused["engine"] == "fused"
    assert not caplog.messages
    # The first scan starts the tracks.
    assert compared.count("step") == 40
    assert position_error(fused) == pytest.approx(position_error(by_numpy), rel=1e-12)


def test_where_the_two_differ_all_blocks_are_numpys(
    scenario: Callable[..., Path], compared: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    """One warning names the model. A second run in this process says it again."""
    file = scenario(BRANCH)
    for _ in range(2):
        fused = mine(file, "fused")
        (line,) = caplog.messages
        assert line.startswith("mine: mine was computed by NumPy: ")
        assert "Mine says pure = True, but machine code and NumPy give different numbers" in line
        assert fused["engine"] == "numpy"
        assert fused["metrics"] == mine(file, "numpy")["metrics"]
        caplog.clear()
