"""Classes of a notebook or script as trackers, models and metrics, which no other process can import."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.past_results import SCENE

import trackbench as tb
from trackbench.metrics import Metric, ratio
from trackbench.models.motion.cv import ConstantVelocity

SIGMA = 0.5
RUNS = {"monte_carlo.runs": 3}


def tracker(offset: float) -> type:
    """A class that no other process can import."""

    class Mine:
        def __init__(self, sigma: float = SIGMA) -> None:
            self.sigma = sigma

        def step(self, state: Any, scan: tb.Scan) -> Any:
            if not scan.valid:
                return state, None
            x, y = scan.measurement
            return (x, y), (np.array([x + offset, y, 8.0, 1.0]), np.eye(4) * self.sigma**2)

    return Mine


def load(**changes: Any) -> tb.Scenario:
    return tb.load(SCENE, {**RUNS, **{key.replace("__", "."): value for key, value in changes.items()}})


def test_a_tracker_runs_in_a_process_of_its_own() -> None:
    result = tb.run(load(trackers__mine={"use": tracker(0.0), "options": {"sigma": 0.15}}))
    assert result["mine"].failed is None
    assert result["mine"].describe == "__main__:Mine, sigma 0.15, all sensors"
    assert result["mine"].position_rmse.value == result["raw"].position_rmse.value


def test_workers_and_another_definition_give_what_they_should() -> None:
    near = load(trackers__mine={"use": tracker(0.0)})
    far = load(trackers__mine={"use": tracker(3.0)}, name="far")
    names = [scenario.config.trackers["mine"].use for scenario in (near, far)]
    assert names[0] != names[1]
    alone, several = tb.run([near, far]), tb.run([near, far], workers=2)
    errors = [[result["mine"].position_rmse.value for result in results] for results in (alone, several)]
    assert errors[0] == errors[1]
    assert errors[0][1] > 2.9 > errors[0][0]


def test_a_function_makes_a_tracker() -> None:
    mine = tracker(0.0)

    def make(sigma: float) -> mine:  # type: ignore[valid-type]
        return mine(sigma)

    make.__annotations__["return"] = mine
    assert tb.run(load(trackers__mine={"use": make, "options": {"sigma": 1.0}}))["mine"].failed is None


@pytest.mark.parametrize("workers", [1, 2])
def test_a_motion_model_and_a_metric(workers: int) -> None:
    class Gentle(ConstantVelocity):
        factor: float = 0.5

    class Square(Metric):
        """The mean square error of the position."""

        name, unit, meaning, better = "square", "m^2", "mean square error of the position", "smaller"

        def init(self, scope: Any) -> Any:
            return np.zeros((2, scope.runs))

        def update(self, sums: Any, chunk: Any) -> Any:
            square = chunk.error[0] ** 2 + chunk.error[1] ** 2
            return sums + np.stack([chunk.by_run(1.0), chunk.by_run(square)])

        def merge(self, blocks: Any) -> Any:
            return np.concatenate(blocks, axis=1)

        def finish(self, sums: Any) -> Any:
            return ratio(sums[1], sums[0], at_least=0.0)

    changes = {"trackers.kf.motion": {"model": Gentle, "acceleration_sigma_mps2": 1}, "score.metrics": [Square]}
    stated = SCENE.replace("kf: {filter: kf, motion: cv, acceleration_sigma_mps2: 1}", "kf: {filter: kf, motion: cv}")
    result = tb.run(tb.load(stated, {**RUNS, **changes}), workers=workers)
    usual = tb.run(load())
    assert result["kf"].position_rmse.value == pytest.approx(usual["kf"].position_rmse.value, rel=1e-9)
    assert result["kf"].metrics["square"].value == pytest.approx(usual["kf"].position_rmse.value ** 2, rel=1e-9)


def test_what_cannot_be_pickled_gives_one_line() -> None:
    lock = threading.Lock()

    class Locked:
        def step(self, state: Any, scan: Any) -> Any:
            return lock

    with pytest.raises(tb.InputError) as refused:
        load(trackers__mine={"use": Locked})
    assert "Locked cannot be sent to another process: TypeError: cannot pickle" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_a_class_that_is_no_tracker_is_named() -> None:
    class Empty:
        pass

    with pytest.raises(tb.InputError, match="'__main__:Empty' is no tracker: Empty has no method step"):
        tb.run(load(trackers__mine={"use": Empty}))


def test_without_the_class_the_command_line_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE.replace("use: raw", 'use: "__main__:Gone"'), encoding="utf-8")
    with pytest.raises(tb.InputError, match="put it into a file, or give tb"):
        tb.run(tmp_path / "scene.yaml")


SCRIPT = f'''
import numpy as np
import trackbench as tb

SIGMA = 0.15

class Mine:
    def step(self, state, scan):
        return scan.time, (np.array([*scan.measurement, 0, 0]), np.eye(4) * SIGMA**2) if scan.valid else None

result = tb.run(tb.load("""{SCENE}""", {{"trackers.mine.use": Mine, "monte_carlo.runs": 2}}))
print(result["mine"].failed, result["mine"].position_rmse.value == result["raw"].position_rmse.value)
'''


@pytest.mark.parametrize("by", ["file", "text"])
def test_a_class_of_a_script_that_is_run(tmp_path: Path, by: str) -> None:
    """Of text, as of a cell, Python does not know the source."""
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    call = ["script.py"] if by == "file" else ["-c", SCRIPT]
    done = subprocess.run([sys.executable, *call], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("None True\n", 0), done.stderr
