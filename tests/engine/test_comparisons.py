"""Equations of users are computed a second way now and then: what that finds, what it costs, and what is said."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.engine.odd_factors import BRANCHES, COUNTERS, OF_THE_BATCH, Factor
from tests.engine.odd_points import straight
from tests.engine.test_constants import by_factor, driven, motion_of, path_by, start
from tests.support.scenes import scan

import trackbench as tb
from trackbench.engine import kernels as kernels_module
from trackbench.engine import user_equations
from trackbench.engine.choice import filter_by
from trackbench.engine.equations import EngineUsed
from trackbench.engine.filters import FusedFilter, checks
from trackbench.engine.kernels import CHANGED, DEPENDENT, OTHER_NUMBERS, Kernels
from trackbench.engine.user_equations import MEMBERS_AT_FIRST, SHARE, Comparisons
from trackbench.filters import Belief, ExtendedKalmanFilter

#: Of which no single draw shows it: an even number of members, as two copies are; members that are in order at first.
NOT_SHOWN = {"shape[1]", "sorted"}


@pytest.fixture
def always(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare at every step."""
    monkeypatch.setattr(user_equations, "SHARE", np.inf)


def by_numpy(factor: Factor) -> EngineUsed:
    checks().comparisons = Comparisons(np.random.default_rng(1))
    filter: Any = filter_by("numpy", ExtendedKalmanFilter(motion_of(by_factor(factor))))
    np.testing.assert_array_equal(path_by(filter), driven(by_factor(factor), None)[0])
    used: EngineUsed = filter.used
    return used


@pytest.mark.usefixtures("always")
@pytest.mark.parametrize("name", [name for name in OF_THE_BATCH if name not in NOT_SHOWN])
def test_numpy_too_finds_what_depends_on_the_batch(name: str) -> None:
    used = by_numpy(OF_THE_BATCH[name])
    assert used.engine == "numpy"
    assert DEPENDENT in used.why_numpy
    assert used.of_user


@pytest.mark.usefixtures("always")
@pytest.mark.parametrize("name", BRANCHES)
def test_numpy_finds_no_fault_where_members_are_apart(name: str) -> None:
    """As with reductions over components."""
    assert by_numpy(BRANCHES[name]) == EngineUsed("numpy")


@pytest.mark.usefixtures("always")
@pytest.mark.parametrize("name", COUNTERS)
def test_asking_numpy_again_changes_no_counter(name: str) -> None:
    checks().comparisons = Comparisons(np.random.default_rng(1))
    filter = filter_by("numpy", ExtendedKalmanFilter(motion_of(by_factor(COUNTERS[name]()))))
    np.testing.assert_array_equal(path_by(filter), driven(by_factor(COUNTERS[name]()), None)[0])


@pytest.mark.usefixtures("always")
@pytest.mark.parametrize("step", [1, 7])
def test_machine_code_that_goes_wrong_is_used_no_more(
    kernels: Kernels, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, run = [0], kernels_module._run

    def wrong(*arguments: Any) -> Any:
        outputs, held = run(*arguments)
        calls[0] += 1
        if calls[0] >= step:
            outputs["mean"] = outputs["mean"] * (1.0 + 1e-4)
        return outputs, held

    monkeypatch.setattr(kernels_module, "_run", wrong)
    path, used = driven(straight, kernels)
    # Predictions, updates and steps are each compared.
    assert step <= calls[0] <= step + 2
    assert used.invalid
    assert OTHER_NUMBERS in used.why_numpy
    np.testing.assert_allclose(path, driven(straight, None)[0], rtol=1e-12)


@pytest.mark.usefixtures("always")
@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_a_component_is_compared_by_itself(kernels: Kernels, monkeypatch: pytest.MonkeyPatch, offset: float) -> None:
    """A speed that is wrong by millimetres a second, at coordinates of a map; its rounding is no fault there."""
    run, wrong = kernels_module._run, [0.0]

    def disturbed(*arguments: Any) -> Any:
        outputs, held = run(*arguments)
        outputs["mean"] = np.concatenate([outputs["mean"][:2], outputs["mean"][2:] + wrong[0]])
        return outputs, held

    monkeypatch.setattr(kernels_module, "_run", disturbed)
    filter = FusedFilter(ExtendedKalmanFilter(motion_of(by_factor(lambda x, dt: 1.0 + 1e-3 * np.sin(x[3])))), kernels)
    belief = start()
    far = belief._replace(mean=belief.mean + np.array([offset, offset, 0.0, 0.0])[:, None])
    for step in range(20):
        wrong[0] = 1e-3 * (step == 19)
        filter.step(far, 0.1, scan("lidar", 0.1, far.mean[:2] + 0.1 * np.sin(step)))
        assert filter.used.invalid == (step == 19)


def test_how_often_each_kind_of_call_is_compared_is_not_up_to_the_clock() -> None:
    comparisons = Comparisons(np.random.default_rng(1))
    comparisons.took(1e9)
    for call in ("step", "update"):
        assert [number for number in range(1, 300) if comparisons.due(call)] == [1, 4, 16, 64, 256]


@pytest.mark.usefixtures("always")
def test_rounding_is_no_fault(kernels: Kernels) -> None:
    """However much a function amplifies it."""

    def factor(x: Any, dt: Any) -> Any:
        turns = 1e13 * np.sin(x[0])
        return 1.0 + 0.1 * (turns - np.floor(turns))

    path, used = driven(by_factor(factor), kernels)
    assert used == EngineUsed("fused")
    assert not np.allclose(path, driven(by_factor(factor), None)[0], rtol=1e-7)


@pytest.mark.usefixtures("always")
def test_what_changes_during_a_run_is_found(kernels: Kernels) -> None:
    gain = [1.0]
    filter: Any = FusedFilter(ExtendedKalmanFilter(motion_of(by_factor(lambda x, dt: gain[0]))), kernels)
    belief = filter.predict(start(), 0.1)
    gain[0] = 1.5
    expected = filter.filter.predict(belief, 0.1)
    np.testing.assert_array_equal(filter.predict(belief, 0.1).mean, expected.mean)
    assert filter.used.invalid
    assert CHANGED in filter.used.why_numpy


def test_at_the_end_of_a_run_it_is_found_in_any_case(kernels: Kernels) -> None:
    gain = [1.0]
    filter: Any = FusedFilter(ExtendedKalmanFilter(motion_of(by_factor(lambda x, dt: gain[0]))), kernels)
    filter.predict(start(), 0.1)
    kernels.comparisons.took(1e9)
    filter.predict(start(), 0.1)
    gain[0] = 1.5
    assert filter.used.invalid


def test_comparisons_take_their_share_of_the_time_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """At instants that the seed draws."""
    now = [0.0]
    monkeypatch.setattr(user_equations.time, "perf_counter", lambda: now[0])

    def instants(seed: int) -> list[int]:
        comparisons, result = Comparisons(np.random.default_rng(seed)), []
        for step in range(20_000):
            now[0] += 1e-4
            if comparisons.due("step"):
                result.append(step)
                now[0] += 1e-3
                comparisons.took(1e-3)
        return result

    first, same, other = instants(1), instants(1), instants(2)
    assert first == same != other
    # The first is due at once.
    assert 0.5 * SHARE < len(first[1:]) * 1e-3 / (20_000 * 1e-4) < SHARE


def test_machine_code_that_was_just_made_is_compared_for_some_members(
    kernels: Kernels, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To compute all of a large block by NumPy once takes as long as many steps by machine code."""
    numbers, by_numpy_alone = [], kernels_module.by_numpy_alone

    def counted(equations: Any, batch: Any, values: Any, outputs: Any, places: Any) -> Any:
        numbers.append(len(places))
        return by_numpy_alone(equations, batch, values, outputs, places)

    monkeypatch.setattr(kernels_module, "by_numpy_alone", counted)
    belief = start()
    many = Belief(np.tile(belief.mean, 100), np.tile(belief.covariance, 100))
    FusedFilter(ExtendedKalmanFilter(motion_of(straight)), kernels).predict(many, 0.1)
    assert numbers == [MEMBERS_AT_FIRST]


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

GAIN = 1.0
CALLS = [0]
COUNT = 0

class Mine(ConstantVelocity):
    linear: ClassVar[bool] = False

    def transition(self, x, dt):
        BODY
        return super().transition(x, dt * GAIN)
"""
BODIES = {
    "if np.all(x[0] > 40): x = 1.01 * x": (OTHER_NUMBERS, True),
    "if np.random.random() < 0: dt = 2 * dt": ("np.random.random is a function that is not known to give", False),
    "if np.any(x[0] > 40): CALLS[0] += 1": (CHANGED, False),
    "if np.any(x[0] > 55): CALLS[0] = 5\n        dt = dt * (1 + CALLS[0])": (CHANGED, False),
    "open('/dev/null').close()": ("open is a function that is not known to give the same for the same", False),
}


@pytest.fixture
def scenario(tmp_path: Path, write_module: Callable[[Path, str], str]) -> Callable[[str], Path]:
    def write(body: str) -> Path:
        name = write_module(tmp_path, MODULE.replace("BODY", body))
        (tmp_path / "mine.yaml").write_text(SCENARIO.replace("MODULE", name))
        return tmp_path / "mine.yaml"

    return write


def mine(file: Path, engine: Any) -> dict[str, Any]:
    """The tracker in the result."""
    (tracker,) = tb.run(file, engine=engine).json()["trackers"]
    result: dict[str, Any] = tracker
    return result


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("body", BODIES)
def test_the_result_is_that_of_numpy_where_machine_code_is_wrong(
    body: str, scenario: Callable[[str], Path], caplog: pytest.LogCaptureFixture
) -> None:
    """In one line it is said why, as a warning; of what depends on the batch also where NumPy was asked for."""
    file, (reason, dependent) = scenario(body), BODIES[body]
    fused = mine(file, "fused")
    (line,) = caplog.messages
    assert line.startswith("mine: mine was computed by NumPy: ")
    assert reason in line
    caplog.clear()
    sys.modules[module_of(file)].CALLS[0] = 0
    by_numpy = mine(file, "numpy")
    assert all(DEPENDENT in message or CHANGED == reason in message for message in caplog.messages)
    # Whether it is depends on the member that is drawn, and on the instant.
    assert len(caplog.messages) <= (dependent or reason == CHANGED)
    assert fused["engine"] == "numpy"
    error, expected = (tracker["metrics"]["position_rmse"]["value"] for tracker in (fused, by_numpy))
    # What machine code of a model has changed is put back.
    assert error == pytest.approx(expected, rel=1e-12)


SETS = {
    "COUNT += 1": "it sets the global COUNT",
    "CALLS[0] += 1": CHANGED,
}


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("body", SETS)
def test_by_numpy_too_it_is_said_that_a_model_changes_itself(
    body: str, scenario: Callable[[str], Path], caplog: pytest.LogCaptureFixture
) -> None:
    mine(scenario(f"global COUNT\n        {body}"), "numpy")
    (line,) = caplog.messages
    assert SETS[body] in line


@pytest.mark.usefixtures("kernels")
def test_dependence_is_found_where_a_model_cannot_be_traced(
    scenario: Callable[[str], Path], caplog: pytest.LogCaptureFixture
) -> None:
    """With the usual cause."""
    mine(scenario("x = x + np.array([1e-3, 0.0, 0.0, 0.0])[:, None] * x[2].mean()"), "fused")
    (line,) = caplog.messages
    assert DEPENDENT in line
    assert "write np.where" in line


@pytest.mark.usefixtures("kernels")
def test_the_terminal_says_it_without_being_asked(scenario: Callable[[str], Path], trackbench: str) -> None:
    command = [trackbench, "run", scenario(next(iter(BODIES))), "--engine", "fused", "--no-recording", "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr.startswith("mine: mine was computed by NumPy: step by ")
    assert done.stderr.count("\n") == 1


@pytest.mark.usefixtures("kernels")
def test_a_parameter_that_is_changed_in_a_notebook_counts(scenario: Callable[[str], Path]) -> None:
    file = scenario("pass")
    errors = []
    for gain in (1.0, 1.2, 1.0):
        for module in [module for name, module in sys.modules.items() if name == module_of(file)]:
            module.GAIN = gain
        fused, by_numpy = (mine(file, engine) for engine in ("fused", "numpy"))
        assert fused["engine"] == "fused"
        error, expected = (tracker["metrics"]["position_rmse"]["value"] for tracker in (fused, by_numpy))
        assert error == pytest.approx(expected, rel=1e-9)
        errors.append(error)
    assert errors[0] == errors[2] != errors[1]


def module_of(file: Path) -> str:
    return file.read_text().split(":Mine")[0].rpartition('"')[2]
