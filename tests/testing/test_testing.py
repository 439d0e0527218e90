"""``check_tracker`` passes what keeps the contract and names every rule that is broken."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.places import DOCS

from trackbench.base.errors import InputError
from trackbench.base.types import Scan
from trackbench.testing import TrackerCheckError, check_tracker
from trackbench.testing.rules import RULES, STATE_KEPT
from trackbench.trackers.answers import Tracker
from trackbench.trackers.builtin import ekf

EXAMPLES = DOCS / "examples"
SIGMAS = {
    "cv": {"acceleration_sigma_mps2": 3},
    "ca": {"jerk_sigma_mps3": 5},
    "ctrv": {"acceleration_sigma_mps2": 3, "yaw_acceleration_sigma_radps2": 0.5},
    "ctra": {"jerk_sigma_mps3": 5, "yaw_acceleration_sigma_radps2": 0.5},
}
KEPT = [rule for rules in RULES["known"] for rule in rules]
(FORM, FOLLOWS, MOVING, MISSES, INSTANT, UNEVEN, LIDAR, RADAR, SAME, LEAVES, ALONE, BATCH) = KEPT


class Good:
    """The straight line of least squares through the latest positions."""

    def step(self, state: Any, scan: Scan) -> Any:
        place = [(scan.time, *self.position(scan))] if scan.valid else []
        seen = [*(state or []), *place][-40:]
        if len(seen) < 4 or seen[-1][0] == seen[0][0]:
            return seen, None
        rows = np.array(seen)
        time, points = rows[:, 0] - rows[:, 0].mean(), rows[:, 1:]
        slope = time @ points / (time @ time)
        position = points.mean(axis=0) + slope * (scan.time - rows[:, 0].mean())
        return seen, (np.array([*position, *slope]), np.diag([1.0, 1.0, 4.0, 4.0]))

    def position(self, scan: Scan) -> tuple[float, float]:
        x, y, yaw = scan.sensor_pose
        if scan.kind == "radar":
            r, angle = scan.measurement[0], yaw + scan.measurement[1]
            return x + r * np.cos(angle), y + r * np.sin(angle)
        u, v = scan.measurement
        return x + np.cos(yaw) * u - np.sin(yaw) * v, y + np.sin(yaw) * u + np.cos(yaw) * v


class GoodBatch:
    """The same of a batch, each member by itself."""

    batched = True

    def step(self, state: Any, scan: Scan) -> Any:
        batch = scan.valid.size
        states, mean, covariance = [], np.full((4, batch), np.nan), np.full((4, 4, batch), np.nan)
        for member in range(batch):
            own = scan._replace(measurement=scan.measurement[:, member], valid=scan.valid[member])
            kept, answer = self.one(state[member] if state else None, own, member)
            states.append(kept)
            if answer is not None:
                mean[:, member], covariance[:, :, member] = answer
        return states, (mean, covariance)

    def one(self, state: Any, scan: Scan, member: int) -> Any:
        return Good().step(state, scan)


def broken(tracker: Callable[..., Tracker], **options: Any) -> dict[str, str]:
    """The rules that the check finds broken, each with its problem."""
    with pytest.raises(TrackerCheckError, match="the tracker breaks these rules:") as caught:
        check_tracker(tracker, **options)
    lines = [line.removeprefix("- ").partition(": ") for line in str(caught.value).splitlines()[1:]]
    return {rule: problem for rules, _, problem in lines for rule in rules.split("; ")}


@pytest.mark.parametrize("tracker", [Good, GoodBatch, "raw"])
def test_what_keeps_the_contract_passes(tracker: Any) -> None:
    assert check_tracker(tracker) == KEPT


@pytest.mark.parametrize(
    ("name", "motion"),
    [*(("ekf", motion) for motion in SIGMAS), ("kf", "ca"), ("ukf", "ctra"), ("ckf", "ctrv")],
)
def test_the_built_in_trackers_pass(name: str, motion: str) -> None:
    check_tracker(name, motion=motion, **SIGMAS[motion])


@pytest.mark.parametrize("use", ["alpha_beta:AlphaBeta", "alpha_beta_batched:BatchedAlphaBeta"])
def test_the_examples_of_the_documentation_pass(use: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(EXAMPLES)
    check_tracker(use, alpha=0.4)


def test_what_cannot_be_started_is_an_input_error() -> None:
    with pytest.raises(InputError, match="did you mean 'raw'"):
        check_tracker("rawr")
    with pytest.raises(
        InputError, match="'raw' does not start with these options: got an unexpected keyword argument 'gain'"
    ):
        check_tracker("raw", gain=1)


def test_state_changed_in_place() -> None:
    class Changes(Good):
        def step(self, state: Any, scan: Scan) -> Any:
            seen = state if state is not None else []
            kept, answer = super().step(seen, scan)
            seen[:] = kept
            return seen, answer

    assert "the state was changed in place" in broken(Changes)[LEAVES]


def test_memory_beside_the_state() -> None:
    class Remembers(Good):
        def __init__(self) -> None:
            self.seen: Any = None

        def step(self, state: Any, scan: Scan) -> Any:
            self.seen, answer = super().step(self.seen, scan)
            return 0, answer

    assert "remembers something beside it" in broken(Remembers)[LEAVES]


@pytest.mark.parametrize("field", ["measurement", "noise_covariance", "sensor_pose", "sensor_velocity"])
@pytest.mark.parametrize("base", [Good, GoodBatch])
def test_scan_changed_in_place(field: str, base: type) -> None:
    class Spoils(base):
        def step(self, state: Any, scan: Scan) -> Any:
            kept = super().step(state, scan)
            getattr(scan, field)[0] = 0
            return kept

    assert broken(Spoils)[FORM] == "ValueError: assignment destination is read-only"


def test_state_shared_by_all_instances() -> None:
    shared: list[Any] = [None]

    class Shares(Good):
        def step(self, state: Any, scan: Scan) -> Any:
            if state is None:
                shared[0] = None
            shared[0], answer = super().step(shared[0], scan)
            return 0, answer

    found = broken(Shares)
    assert "a second tracker at work at the same time changes its answers" in found[ALONE]
    assert SAME not in found


def test_chance() -> None:
    random = np.random.default_rng()

    class Guesses(Good):
        def step(self, state: Any, scan: Scan) -> Any:
            state, answer = super().step(state, scan)
            return state, answer and (answer[0] + random.normal(0, 0.01, 4), answer[1])

    assert "different estimates of the same measurements" in broken(Guesses)[SAME]
    says_so = type("SaysSo", (Guesses,), {"random": True})
    assert check_tracker(says_so) == [*RULES["known"][0]]


def test_nan_on_a_missed_measurement() -> None:
    class Blind(Good):
        def step(self, state: Any, scan: Scan) -> Any:
            state, answer = super().step(state, scan)
            return state, answer and (answer[0] + 0 * scan.measurement[0], answer[1])

    found = broken(Blind)
    assert list(found) == [MISSES]
    assert found[MISSES].startswith("the estimate is not finite at")


def test_none_on_a_missed_measurement() -> None:
    class Silent(Good):
        def step(self, state: Any, scan: Scan) -> Any:
            state, answer = super().step(state, scan)
            return state, answer if scan.valid else None

    found = broken(Silent)
    assert list(found) == [MISSES]
    assert found[MISSES].startswith("it gave None after an estimate")


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        ((np.ones(3), np.eye(4)), "the mean has the shape (3,), where (4,) is needed"),
        ((np.ones(4), np.ones(4)), "the covariance has the shape (4,), where (4, 4) is needed"),
        ((np.ones(4), np.triu(np.ones((4, 4)))), "the covariance is not symmetric"),
        ((np.ones(4), -np.eye(4)), "the covariance is not positive definite at 0 s"),
        (np.ones(4), "step must return (state, (mean, covariance)), not (state, ndarray"),
        (None, "120 measurements of one target give no estimate"),
    ],
)
def test_the_wrong_form(answer: Any, problem: str) -> None:
    class Wrong:
        def step(self, state: Any, scan: Scan) -> Any:
            return state, answer

    assert broken(Wrong)[FORM].startswith(problem)


def test_the_sensor_s_frame_taken_for_the_fixed_one() -> None:
    class Ignores(Good):
        def position(self, scan: Scan) -> tuple[float, float]:
            return super().position(scan._replace(sensor_pose=np.zeros(3)))

    found = broken(Ignores)
    assert {FOLLOWS, MOVING} <= found.keys()
    assert found[FOLLOWS].endswith("m off a target in plain sight")


def test_a_standing_sensor_taken_for_granted() -> None:
    class Stands:
        batched = True

        def __init__(self) -> None:
            self.filter = ekf(motion="cv", acceleration_sigma_mps2=3)

        def step(self, state: Any, scan: Scan) -> Any:
            return self.filter.step(state, scan._replace(sensor_velocity=np.zeros(2)))

    assert list(broken(Stands)) == [MOVING]


def test_a_time_step_taken_for_granted() -> None:
    class Divides(Good):
        def step(self, state: Any, scan: Scan) -> Any:
            if state and scan.time == state[-1][0]:
                raise ZeroDivisionError("float division by zero")
            return super().step(state, scan)

    assert broken(Divides) == {INSTANT: "ZeroDivisionError: float division by zero"}


@pytest.mark.parametrize(("kind", "rule"), [("lidar", RADAR), ("radar", LIDAR)])
def test_a_sensor_that_must_be_there(kind: str, rule: str) -> None:
    class Needs(Good):
        def step(self, state: Any, scan: Scan) -> Any:
            seen, kinds = state or (None, set())
            seen, answer = super().step(seen, scan)
            kinds = kinds | {scan.kind}
            if len(seen) == 40 and kind not in kinds:
                raise LookupError(f"no {kind}")
            return (seen, kinds), answer

    assert broken(Needs) == {rule: f"LookupError: no {kind}"}


def test_a_batch_that_is_not_the_loop() -> None:
    class Mixes(GoodBatch):
        def one(self, state: Any, scan: Scan, member: int) -> Any:
            state, answer = super().one(state, scan, member)
            return state, answer and (answer[0] + member * 1e-6, answer[1])

    found = broken(Mixes)
    assert list(found) == [BATCH]
    assert found[BATCH] == "run 1 of a batch of 3 has another answer than alone"


def test_a_program_is_checked_by_its_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = files("trackbench.subjects.templates").joinpath("languages", "tracker_program.py.j2").read_text()
    (tmp_path / "program.py").write_text(source)
    monkeypatch.chdir(tmp_path)
    use = {"command": [sys.executable, "program.py"]}
    rules = check_tracker(use, acceleration=2.0)
    assert "does not disturb another tracker" in rules
    assert STATE_KEPT not in rules
    (tmp_path / "program.py").write_text(source.replace('states[message["id"]] =', "states[1] ="))
    with pytest.raises(TrackerCheckError, match="follows a target in plain sight"):
        check_tracker(use)
    with pytest.raises(InputError, match=r"a path has a /, such as ./program.py"):
        check_tracker({"command": ["program.py"]})
    with pytest.raises(InputError, match="write a published name"):
        check_tracker({"comand": []})
