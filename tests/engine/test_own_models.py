"""Motion models of users: compiled where they say that they are pure and can be traced, else computed by NumPy."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.engine import agreement, own_models
from tests.engine.agreement import drive
from tests.engine.own_models import Fading

from trackbench.base.types import Estimate, Scan
from trackbench.engine.choice import Engine
from trackbench.engine.equations import EngineUsed
from trackbench.filters import Belief, ExtendedKalmanFilter, SigmaPointFilter, SymmetricSet
from trackbench.models.motion import MotionModel
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.initial import InitialConfig

pytestmark = pytest.mark.usefixtures("kernels")
FIRST = InitialConfig.model_validate({"from": "first_measurement", "velocity_sigma_mps": 10})
SCANS = drive(12, 9, ["lidar", "radar"]).scans


def tracked(
    model: MotionModel,
    engine: Engine,
    scans: list[Scan] = SCANS,
    kind: type = ExtendedKalmanFilter,
    start: InitialConfig = FIRST,
) -> tuple[list[Estimate], EngineUsed]:
    """What a filter with the model says of all scans, and what computed it."""
    filter = SigmaPointFilter(model, SymmetricSet(1.0, 2.0, 0.0)) if kind is SigmaPointFilter else kind(model)
    tracker = FilterTracker(filter, start, engine=engine)
    state, said = None, []
    for scan in scans:
        state, estimate = tracker.step(state, scan)
        said.append(estimate)
    return said, tracker.engine_used


def difference(said: list[Estimate], other: list[Estimate]) -> float:
    """The largest of two rows of estimates, of the tracks that both have."""
    largest = 0.0
    for one, two in zip(said, other, strict=True):
        there = np.isfinite(two.mean[0])
        np.testing.assert_array_equal(np.isfinite(one.mean[0]), there)
        pair = [Belief(each.mean[:, there], each.covariance[..., there]) for each in (one, two)]
        largest = max(largest, agreement.apart(*pair, ((),)))
    return largest


COMPILED = [
    own_models.Fading,
    own_models.Nonlinear,
    own_models.ComputedOnce,
    own_models.OptionAsNumber,
    own_models.ReadsModule,
]
NOT_TRACED = {
    own_models.ByLinearAlgebra: "a number is asked for",
    own_models.BranchOnTime: "a branch on a single value",
    own_models.ChangesItsInput: "read-only",
}
NOT_PURE = [
    own_models.CountsCalls,
    own_models.LooksAtTheNext,
    own_models.AsksForAnArray,
]


@pytest.mark.parametrize("model", COMPILED, ids=lambda model: model.__name__)
@pytest.mark.parametrize("filter", [ExtendedKalmanFilter, SigmaPointFilter], ids=["ekf", "ukf"])
def test_what_can_be_traced_is_compiled(model: type[Fading], filter: type) -> None:
    """Also for other options of the same class."""
    for options in ({}, {"time_constant_s": 1.5}, {"time_constant_s": 1.5, "acceleration_sigma_mps2": 0.7}):
        said, used = tracked(model(**options), "fused", kind=filter)
        expected, _ = tracked(model(**options), "numpy", kind=filter)
        assert used == EngineUsed("fused")
        assert difference(said, expected) < agreement.LIMIT


@pytest.mark.parametrize("model", NOT_TRACED, ids=lambda model: model.__name__)
def test_what_cannot_be_traced_is_computed_by_numpy(model: type[Fading]) -> None:
    said, used = tracked(model(), "fused")
    expected, _ = tracked(model(), "numpy")
    assert NOT_TRACED[model] in used.why_numpy
    assert used.of_pure
    assert not used.differs
    assert used.engine != "fused"
    assert difference(said, expected) == 0.0


@pytest.mark.parametrize("filter", [ExtendedKalmanFilter, SigmaPointFilter], ids=["ekf", "ukf"])
@pytest.mark.parametrize("model", NOT_PURE, ids=lambda model: model.__name__)
def test_what_says_wrongly_that_it_is_pure_is_found_to_differ(model: type[Fading], filter: type) -> None:
    """With one reason, whatever the number of kernels that differ."""
    _, used = tracked(model(), "fused", kind=filter)
    assert used.differs
    assert used.of_pure
    assert used.engine != "fused"
    assert used.why_numpy.count(f"{model.__name__} says pure = True, but machine code and NumPy give different") == 1


def test_a_class_says_for_itself_that_it_is_pure() -> None:
    """Not for those that inherit from it."""
    said, used = tracked(own_models.Silent(), "fused")
    assert used.engine == "numpy"
    assert "Silent does not say pure = True" in used.why_numpy
    assert not used.of_pure
    assert difference(said, tracked(own_models.Silent(), "numpy")[0]) == 0.0


def test_the_line_that_cannot_be_traced_is_named() -> None:
    for model, function in ((own_models.ByLinearAlgebra, "noise_gain"), (own_models.ChangesItsInput, "transition")):
        _, used = tracked(model(), "fused")
        assert re.search(rf"\(.*own_models\.py:\d+, in {function}\)", used.why_numpy)


MODULE = """
from typing import ClassVar
from tests.engine.own_models import Fading, np

class Edited(Fading):
    linear: ClassVar[bool] = False
    pure = True

    def left(self, x, dt):
        return np.exp(-{rate} * dt)
"""


@pytest.fixture
def edited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[float], Any]]:
    """Writes a module, and imports it anew."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def write(rate: float) -> Any:
        (tmp_path / "edited_motion.py").write_text(MODULE.format(rate=rate))
        importlib.invalidate_caches()
        known = sys.modules.get("edited_motion")
        return importlib.import_module("edited_motion") if known is None else importlib.reload(known)

    yield write
    sys.modules.pop("edited_motion", None)


def test_a_model_that_is_edited_has_its_new_equations(edited: Callable[[float], Any]) -> None:
    found = []
    for rate in (0.1, 0.9):
        module = edited(rate)
        said, used = tracked(module.Edited(), "fused")
        assert used == EngineUsed("fused")
        assert difference(said, tracked(module.Edited(), "numpy")[0]) < agreement.LIMIT
        found.append(said[-1].mean[2, 0])
    assert found[0] != found[1]
