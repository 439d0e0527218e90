"""A tracker that goes wrong is reported with its cause and place; the others are as if it were not there."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from trackbench.results import MetricValue, Result, json_text

Run = Callable[..., Result]
Write = Callable[[Path, str], str]

HEAD = """
import sys
import numpy as np
from trackbench.base.types import Estimate

class Counts:
    def step(self, state, scan):
        number = (state or 0) + 1
        return number, self.answer(number, scan)

def usual(scan):
    batch = np.shape(scan.valid)
    return np.ones((4, *batch)), np.broadcast_to(np.eye(4).reshape(4, 4, *[1] * len(batch)), (4, 4, *batch)).copy()

"""

# The scans of an object come at 0 s (radar, lidar), 0.1 s (radar), 0.2 s (radar, lidar), ...
FIRST = {"step": 0, "time_s": 0.0, "sensor": "radar", "run": 0, "object": "v1"}
THIRD = {"step": 1, "time_s": 0.1, "sensor": "radar", "run": 0, "object": "v1"}

DECIDED = {**FIRST, "sensor": None}  # by the estimate after the last scan of the instant
READ_ONLY = "ValueError: assignment destination is read-only"
TOO_LARGE = "the error, or its ratio to the covariance, is too large for any score"

# Body of answer(self, number, scan), the cause, and where.
ANSWERS = {
    "raises": ("if number == 3: raise ValueError('no\\nmore')\nreturn usual(scan)", "ValueError: no", THIRD),
    "asserts": ("assert number < 3\nreturn usual(scan)", "AssertionError", THIRD),
    "exits": ("sys.exit(0) if number == 3 else None\nreturn usual(scan)", "SystemExit: 0", THIRD),
    "recurses": ("return self.answer(number, scan)", "RecursionError: maximum recursion depth exceeded", FIRST),
    "nan": ("return np.array([1, 1, 1, np.nan if number == 3 else 1]), np.eye(4)", "the estimate is not finite", THIRD),
    "masked": (
        "return np.ma.array(np.ones(4), mask=[number == 3] + 3 * [False]), np.eye(4)",
        "the estimate is not finite",
        THIRD,
    ),
    "infinite": ("return np.ones(4), np.full((4, 4), np.inf)", "the estimate is not finite", FIRST),
    "shape": ("return np.ones(3), np.eye(4)", "the mean has the shape (3,), where (4,) is needed", FIRST),
    "size": ("return np.ones(4), np.eye(2)", "the covariance has the shape (2, 2), where (4, 4) is needed", FIRST),
    "text": ("return 'here', np.eye(4)", "the mean is not an array of numbers: str 'here'", FIRST),
    "complex": ("return np.ones(4) * 1j, np.eye(4)", "the mean is not an array of numbers: ndarray", FIRST),
    "single": ("return np.ones(4)", "step must return (state, (mean, covariance)), not (state, ndarray", FIRST),
    "asymmetric": ("return np.ones(4), np.eye(4) + np.eye(4, k=1)", "the covariance is not symmetric", FIRST),
    "indefinite": (
        "return np.ones(4), np.diag([1.0, 1, 1, -1 if number > 2 else 1])",
        "the covariance is not positive definite",
        {**THIRD, "sensor": None},
    ),
    "singular": ("return np.ones(4), np.zeros((4, 4))", "the covariance is not positive definite", DECIDED),
    "far": ("return np.full(4, 1e200), np.eye(4)", TOO_LARGE, DECIDED),
    "sure": ("return np.ones(4), np.eye(4) * 1e-300", TOO_LARGE, DECIDED),
    "none_later": ("return usual(scan) if number < 3 else None", "it gave None after an estimate", THIRD),
    "never": ("return None", "it gave no estimate at all", {"step": 20, "time_s": 2.0, "run": None, "object": None}),
    "repaired": ("return Estimate(*usual(scan), repaired=np.zeros(3))", "repaired has the shape (3,), where ()", FIRST),
    "writes_measurement": ("scan.measurement[:] = 0\nreturn usual(scan)", READ_ONLY, FIRST),
    "writes_noise": ("scan.noise_covariance[:] = 0\nreturn usual(scan)", READ_ONLY, FIRST),
    "writes_pose": ("scan.sensor_pose[0] += 5\nreturn usual(scan)", READ_ONLY, FIRST),
}
WHOLE = {
    "not_a_pair": ("def step(self, state, scan): return usual(scan)[0]", "step must return (state, estimate), not"),
    "batch_writes": (
        "batched = True\n    def step(self, state, scan): scan.valid[:] = True; return 1, usual(scan)",
        READ_ONLY,
    ),
    "batch_infinite": (
        "batched = True\n    def step(self, state, scan): mean, P = usual(scan); P[1, 1] = np.inf; return 1, (mean, P)",
        "the estimate is not finite",
    ),
    "batch_nan": (
        "batched = True\n    def step(self, state, scan):\n        mean, covariance = usual(scan)\n"
        "        mean[2, 6] = np.nan if scan.time > 0.05 else 0\n        return 1, (mean, covariance)",
        "the estimate is not finite",
    ),
    "batch_masked": (
        "batched = True\n    def step(self, state, scan):\n        mean, covariance = usual(scan)\n"
        "        mean = np.ma.array(mean)\n        if scan.time > 0.05: mean[2, 6] = np.ma.masked\n"
        "        return 1, (mean, covariance)",
        "the estimate is not finite",
    ),
    "batch_asymmetric": (
        "batched = True\n    def step(self, state, scan): mean, P = usual(scan); P[0, 1, 5] = 0.5; return 1, (mean, P)",
        "the covariance is not symmetric: mirrored entries differ by up to 0.5",
    ),
    "batch_shape": (
        "batched = True\n    def step(self, state, scan): return 1, (np.ones(4), np.eye(4))",
        "the mean has the shape (4,), where (4, 8) is needed",
    ),
    "batch_none_later": (
        "batched = True\n    def step(self, state, scan): return 1, (None if state else usual(scan))",
        "it gave None after an estimate",
    ),
}  # fmt: skip


def indented(code: str, by: str) -> str:
    return "".join(by + line + "\n" for line in code.split("\n"))


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory, write_module: Write, run_tiny: Run) -> Result:
    """A run of all of them beside the tiny scenario's own trackers."""
    folder = tmp_path_factory.mktemp("failing")
    code = HEAD
    for name, (body, _, _) in ANSWERS.items():
        code += f"class {name}(Counts):\n    def answer(self, number, scan):\n{indented(body, '        ')}\n"
    for name, (body, _) in WHOLE.items():
        code += f"class {name}:\n    {body}\n"
    module = write_module(folder, code)
    return run_tiny(*(f"trackers.{name}.use={module}:{name}" for name in (*ANSWERS, *WHOLE)), folder=folder)


def entry(result: Result, name: str) -> dict[str, Any]:
    return next(tracker for tracker in result.json()["trackers"] if tracker["name"] == name)


@pytest.mark.parametrize("name", ANSWERS)
def test_the_cause_and_the_place_are_reported(outcome: Result, name: str) -> None:
    failed = entry(outcome, name)["failed"]
    _, cause, place = ANSWERS[name]
    assert failed["cause"].startswith(cause)
    assert "\n" not in failed["cause"]
    assert {key: failed[key] for key in place} == place


@pytest.mark.parametrize("name", WHOLE)
def test_the_cause_is_reported(outcome: Result, name: str) -> None:
    assert entry(outcome, name)["failed"]["cause"].startswith(WHOLE[name][1])


def test_the_lane_of_a_batch_is_named(outcome: Result) -> None:
    # Members are runs within objects: of 2 objects and 4 runs, member 6 is run 2 of the second object.
    failed = entry(outcome, "batch_nan")["failed"]
    assert (failed["run"], failed["object"], failed["step"]) == (2, outcome.json()["truth"]["objects"][1], 1)


def numbers(metrics: dict[str, MetricValue]) -> Iterator[tuple[str, float]]:
    """Every number of the metrics but the time of a step."""
    for path, metric in metrics.items():
        if path != "step_time" and metric.value is not None:
            yield path, metric.value
            yield from ((f"{path} {end}", value) for end, value in zip("lh", metric.ci95 or (), strict=False))


def test_the_result_has_no_nan_and_every_metric_a_reason(outcome: Result) -> None:
    parsed = json.loads(json_text(outcome.json()), parse_constant=pytest.fail)
    for tracker in parsed["trackers"]:
        if tracker["failed"]:
            assert tracker["metrics"]["position_rmse"] == {"value": None, "unit": "m", "reason": "the tracker failed"}


def test_exit_status_and_message(
    cli: Callable[..., Any], tiny: Path, tmp_path: Path, write_module: Write, trackbench: str
) -> None:
    code = HEAD + "class T:\n    def step(self, state, scan):\n        raise OSError('no licence')"
    module = write_module(tmp_path, code)
    expect = "expect=[{tracker: mine, metric: position_rmse, below: 100}]"
    done = cli("run", "tiny.yaml", "--set", f"trackers.mine.use={module}:T", "--set", expect)
    assert done.status == 3, "a failed tracker counts more than its failed expectation"
    place = f"{module}.py:{code.count(chr(10)) + 1}, in step"
    assert f"FAILED mine: OSError: no licence ({place}, step 0, 0.00 s, sensor radar, run 0, object v1)" in " ".join(
        done.out.split()
    )
    assert done.err == ""
    assert {path.name for path in (tmp_path / "results" / "tiny").iterdir()} >= {"report.html", "recording.rrd"}


def test_a_run_whose_only_tracker_fails_still_leaves_everything(
    cli: Callable[..., Any], tiny: Path, tmp_path: Path, write_module: Write
) -> None:
    module = write_module(tmp_path, "class T:\n    def step(self, state, scan):\n        return 1 / 0")
    done = cli("run", "tiny.yaml", "--set", f"trackers={{mine: {{use: '{module}:T'}}}}")
    assert (done.status, done.err) == (3, "")
    assert "ZeroDivisionError" in (tmp_path / "results" / "tiny" / "report.html").read_text(encoding="utf-8")


# What is wrong before the first step is bad input: code of a module, what is named in it, and the message.
BROKEN_MODULES = [
    ("class T\n    pass\n", "T", "cannot import '{0}:T': SyntaxError: expected ':'"),
    ("import no_such_package\n", "T", "cannot import '{0}:T': no module named 'no_such_package'"),
    ("class T:\n    pass\n", "T", "'{0}:T' is no tracker: T has no method step(state, scan)"),
    (
        "class T:\n    def step(self, state, scan): ...\n    def __init__(self): raise RuntimeError('no licence')\n",
        "T",
        "'{0}:T' does not start with these options: RuntimeError: no licence",
    ),
]


@pytest.mark.parametrize(("code", "name", "message"), BROKEN_MODULES)
def test_what_cannot_start_is_bad_input(
    cli: Callable[..., Any], tiny: Path, tmp_path: Path, write_module: Write, code: str, name: str, message: str
) -> None:
    module = write_module(tmp_path, code)
    text = tiny.read_text(encoding="utf-8").replace("use: raw", f"use: '{module}:{name}'")
    tiny.write_text(text, encoding="utf-8")
    # What fails only when it is started is found by a run: check calls nothing of a plug-in's.
    starts = "__init__" in code
    assert cli("check", "tiny.yaml").status == (0 if starts else 2)
    for command in ["run"] if starts else ["check", "run"]:
        done = cli(command, "tiny.yaml")
        assert (done.status, done.out) == (2, "")
        assert done.err.startswith("tiny.yaml:15: trackers.raw.use: " + message.format(module)), done.err
        assert len(done.err.splitlines()) == 1
