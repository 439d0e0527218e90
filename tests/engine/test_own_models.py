"""Motion models of users: compiled where a trace says all of them, and computed by NumPy where not."""

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
from tests.support.scenes import member

from trackbench.base.types import Estimate, Scan
from trackbench.engine.choice import Engine
from trackbench.engine.equations import EngineUsed
from trackbench.engine.filters import fused_filter
from trackbench.filters import Belief, ExtendedKalmanFilter, SigmaPointFilter, scaled_points
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
    filter = SigmaPointFilter(model, scaled_points(1.0, 2.0, 0.0)) if kind is SigmaPointFilter else kind(model)
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
    own_models.ComputedFirst,
    own_models.ComputedOnce,
    own_models.OptionAsNumber,
    own_models.ReadsModule,
]
NOT_COMPILED = {
    own_models.KeepsResults: "_left is of type _lru_cache_wrapper",
    own_models.RemembersNumbers: "_left_of_number is of type _lru_cache_wrapper",
    own_models.ByLinearAlgebra: "a number is asked for",
    own_models.BranchOnTime: "a branch on a single value",
    own_models.LoopOnState: "those of the batch among them",
    own_models.ChangesItsInput: "read-only",
    own_models.ClearsItsInput: "read-only",
    own_models.Random: "Random._random is of type Generator",
    own_models.CountsCalls: "it sets the attribute _calls (tests/engine/own_models.py:",
    own_models.CountsInItsClass: "it changes what it reads",
    own_models.TakesTheLargest: "those of the batch among them",
    own_models.Swallows: "it handles errors (tests/engine/own_models.py:",
    own_models.AsksForATime: "it asks for a type (tests/engine/own_models.py:",
    own_models.AsksForAnArray: "it asks for a type (tests/engine/own_models.py:",
    own_models.LooksAtTheNext: "some members are picked out of the batch",
}


@pytest.mark.parametrize("model", COMPILED, ids=lambda model: model.__name__)
@pytest.mark.parametrize("filter", [ExtendedKalmanFilter, SigmaPointFilter], ids=["ekf", "ukf"])
def test_what_can_be_traced_is_compiled(model: type[Fading], filter: type) -> None:
    """Also for other options of the same class."""
    for options in ({}, {"time_constant_s": 1.5}, {"time_constant_s": 1.5, "acceleration_sigma_mps2": 0.7}):
        said, used = tracked(model(**options), "fused", kind=filter)
        expected, _ = tracked(model(**options), "numpy", kind=filter)
        assert used == EngineUsed("fused")
        assert difference(said, expected) < agreement.LIMIT


FILTERS = {"ekf": ExtendedKalmanFilter, "ukf": SigmaPointFilter}
#: Of the copies that sigma points are, nothing is kept.
HARMLESS = [(model, "ukf") for model in (own_models.ChangesItsInput, own_models.ClearsItsInput)]


@pytest.mark.parametrize("model", NOT_COMPILED, ids=lambda model: model.__name__)
@pytest.mark.parametrize("filter", FILTERS)
def test_what_cannot_be_traced_is_computed_by_numpy(model: type[Fading], filter: str) -> None:
    said, used = tracked(model(), "fused", kind=FILTERS[filter])
    expected, _ = tracked(model(), "numpy", kind=FILTERS[filter])
    if (model, filter) in HARMLESS:
        assert used == EngineUsed("fused")
        assert difference(said, expected) < agreement.LIMIT
    else:
        assert NOT_COMPILED[model] in used.why_numpy
        assert used.engine != "fused"
        assert difference(said, expected) == 0.0


def test_a_model_of_single_objects_is_computed_by_numpy() -> None:
    """With a branch on a number, which a batch has not."""
    scans = [member(scan, 0) for scan in drive(12, 1, ["lidar"], valid=1.0).scans]
    said, used = tracked(own_models.BranchOnState(), "fused", scans)
    expected, _ = tracked(own_models.BranchOnState(), "numpy", scans)
    assert "a branch on a single value" in used.why_numpy
    for one, two in zip(said, expected, strict=True):
        np.testing.assert_array_equal(one.mean, two.mean)


def test_a_trace_leaves_the_model_as_it_is() -> None:
    model = own_models.CountsCalls()
    fused_filter(ExtendedKalmanFilter(model)).predict(Belief(np.ones((4, 3)), np.stack([np.eye(4)] * 3, axis=-1)), 0.1)
    assert model._calls == 1


def test_the_line_that_cannot_be_traced_is_named() -> None:
    for model, function in ((own_models.ByLinearAlgebra, "noise_gain"), (own_models.ChangesItsInput, "transition")):
        _, used = tracked(model(), "fused")
        assert re.search(rf"\(.*own_models\.py:\d+, in {function}\)", used.why_numpy)


MODULE = """
from types import SimpleNamespace
from typing import ClassVar
from tests.engine.own_models import Fading, np

FACTOR = 1.0
SET = SimpleNamespace(factor=1.0)

class Edited(Fading):
    linear: ClassVar[bool] = False

    def left(self, x, dt):
        within = lambda value: FACTOR * value
        return SET.factor * within(np.exp(-{rate} * dt))
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
        for factor, other in ((1.0, 1.0), (0.8, 1.0), (1.0, 0.7)):
            module.FACTOR, module.SET.factor = factor, other
            said, used = tracked(module.Edited(), "fused")
            assert used == EngineUsed("fused")
            assert difference(said, tracked(module.Edited(), "numpy")[0]) < agreement.LIMIT
            found.append(said[-1].mean[2, 0])
    assert len(set(found)) == 6


@pytest.mark.parametrize(
    "model", [*COMPILED, own_models.BranchOnTime, own_models.Random], ids=lambda model: model.__name__
)
def test_a_start_from_the_first_measurement(model: type[Fading]) -> None:
    start = InitialConfig.model_validate({"velocity_sigma_mps": 10})
    said, used = tracked(model(), "fused", start=start)
    expected, _ = tracked(model(), "numpy", start=start)
    assert np.isfinite(said[-1].mean).all()
    assert used.engine == "fused" or model not in COMPILED
    assert difference(said, expected) < 1e-10
