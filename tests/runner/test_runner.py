"""A scenario times trackers times runs: what a result holds, and what it does not depend on."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from trackbench.metrics.covariance_words import verdict_in_words
from trackbench.results import Difference, Result, json_text
from trackbench.runner import evaluated, work
from trackbench.scenario.keys import Expectation

Run = Callable[..., Result]
Write = Callable[[Path, str], str]

BATCHED = """
import numpy as np

class Fixed:
    '''Follows the lidar alone, with a fixed gain.'''
    batched = {batched}

    def __init__(self, gain=0.6):
        self.gain = gain

    def step(self, state, scan):
        batch = np.shape(scan.valid)
        if state is None:
            state = np.full((4, *batch), np.nan)
        if scan.kind == "lidar":
            x, y, yaw = scan.sensor_pose
            c, s = np.cos(yaw), np.sin(yaw)
            u, v = scan.measurement
            seen = np.stack([x + c * u - s * v, y + s * u + c * v, 25 + 0 * u, 0 * u])
            state = np.where(scan.valid, np.where(np.isnan(state), seen, state + self.gain * (seen - state)), state)
        if not batch and np.isnan(state).any():
            return state, None
        return state, (state, 4 * np.broadcast_to(np.eye(4).reshape(4, 4, *[1] * len(batch)), (4, 4, *batch)))
"""


def tracker(result: Result, name: str) -> dict[str, Any]:
    return next(entry for entry in result.json()["trackers"] if entry["name"] == name)


def numbers(node: Any, path: str = "") -> dict[str, float]:
    """Every number of a nested value by its path, but for the times."""
    if isinstance(node, dict):
        return {
            k: v
            for key, value in node.items()
            if key != "step_time"
            for k, v in numbers(value, f"{path}.{key}").items()
        }
    if isinstance(node, list):
        return {k: v for i, value in enumerate(node) for k, v in numbers(value, f"{path}.{i}").items()}
    return {path: node} if isinstance(node, int | float) else {}


def column(table: pa.Table, name: str, **where: Any) -> np.ndarray:
    keep = np.ones(len(table), dtype=bool)
    for key, value in where.items():
        keep &= np.array([item == value for item in table[key].to_pylist()])
    return table[name].to_numpy(zero_copy_only=False)[keep]


def test_verdicts_on_covariances_are_in_plain_words_too(tiny_result: Result) -> None:
    nees = tracker(tiny_result, "ekf")["metrics"]["nees"]
    assert nees["words"] == verdict_in_words(tiny_result["ekf"].nees, tiny_result["ekf"].conditions)
    assert "words" not in tracker(tiny_result, "ekf")["metrics"]["position_rmse"]


def test_blocks_merge_exactly(run_tiny: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run_tiny("monte_carlo.runs=7")
    monkeypatch.setattr(work, "BATCH_SIZE", 4)  # two objects: two runs to a block, and one in the last
    parts = run_tiny("monte_carlo.runs=7")
    assert parts.summary.fingerprint == whole.summary.fingerprint
    assert parts.json()["ranking"] == whole.json()["ranking"]
    for name in ("raw", "ekf"):
        one, two = (numbers(tracker(result, name)) for result in (whole, parts))
        assert one.keys() == two.keys()
        assert len(one) > 40
        for path, value in one.items():
            assert two[path] == pytest.approx(value, rel=1e-12, abs=1e-12), path
    for name, table in whole.tables.items():
        other = parts.tables[name]
        assert other.schema == table.schema
        for field in table.column_names:
            if not pa.types.is_floating(table.schema.field(field).type):
                assert other[field].to_pylist() == table[field].to_pylist(), field
            elif not field.startswith("position_p"):  # percentiles are those of the first block
                np.testing.assert_allclose(column(other, field), column(table, field), rtol=1e-12, atol=1e-12)


def test_a_run_does_not_depend_on_the_others(run_tiny: Run) -> None:
    few, many = (run_tiny(f"monte_carlo.runs={runs}", "recording.run=2") for runs in (3, 6))
    assert few.tables["measurements"].equals(many.tables["measurements"])
    assert few.tables["estimates"].equals(many.tables["estimates"])
    for name in ("position_rmse_m", "nees_mean"):
        for who in ("raw", "ekf"):
            few_runs = column(few.tables["runs"], name, tracker=who)
            # The sums of a run go through BLAS, whose rounding on some processors depends on how many runs are summed.
            np.testing.assert_allclose(few_runs, column(many.tables["runs"], name, tracker=who)[:3], rtol=1e-14)
    assert few.summary.fingerprint != many.summary.fingerprint


def test_the_fingerprint_is_that_of_the_measurements(run_tiny: Run, tiny_result: Result) -> None:
    same = ["score.settle_s=1", "trackers={raw: {use: raw}}", "recording.run=1"]
    other = ["monte_carlo.seed=8", "sensors.lidar.position_sigma_m=0.16", "truth.seed=2", "name: x"]
    print_of = tiny_result.summary.fingerprint
    for override in same:
        assert run_tiny(override).summary.fingerprint == print_of, override
    found = {run_tiny(override.replace("name: ", "name=")).summary.fingerprint for override in other}
    assert len(found | {print_of}) == len(other) + 1


def test_every_tracker_sees_the_same_measurements(run_tiny: Run, tmp_path: Path, write_module: Write) -> None:
    code = (
        "import numpy as np\nclass Spy:\n    batched = True\n    def step(self, state, scan):\n"
        "        read = (scan.measurement, scan.valid, scan.sensor_pose, scan.sensor_velocity, scan.noise_covariance)\n"
        "        with open(self.file, 'a') as file:\n"
        "            print(scan.time, scan.sensor, *(item.tobytes().hex() for item in read), file=file)\n"
        "        batch = scan.valid.size\n"
        "        return 1, (np.ones((4, batch)), np.eye(4)[:, :, None] * np.ones(batch))\n"
        "    def __init__(self, file):\n        self.file = file\n"
    )
    module = write_module(tmp_path, code)
    file = {tag: tmp_path / f"{tag}.txt" for tag in ("a", "b")}
    spies = {tag: f"trackers.{tag}={{use: '{module}:Spy', options: {{file: {file[tag]}}}}}" for tag in file}
    ukf = "trackers.ukf={filter: ukf, motion: ctrv, acceleration_sigma_mps2: 3, yaw_acceleration_sigma_radps2: 1}"
    run_tiny(spies["a"], ukf, spies["b"], folder=tmp_path)  # a filter works between the two
    seen = {tag: path.read_text(encoding="utf-8").splitlines() for tag, path in file.items()}
    assert len(seen["a"]) == 2 * (21 + 11)  # each scan twice: once all were given, again with other company
    assert seen["a"] == seen["b"]
    first = [line.split()[:2] for line in seen["a"][:4]]
    assert first == [["0.0", "radar"], ["0.0", "lidar"], ["0.1", "radar"], ["0.2", "radar"]]


def test_a_batched_plug_in_equals_a_looped_one(run_tiny: Run, tmp_path: Path, write_module: Write) -> None:
    uses = [write_module(tmp_path, BATCHED.format(batched=batched)) for batched in (True, False)]
    result = run_tiny(
        *(
            f"trackers.{name}={{use: '{use}:Fixed', options: {{gain: 0.5}}}}"
            for name, use in zip("ab", uses, strict=True)
        ),
        "sensors.lidar.detection_probability=0.4",
        "monte_carlo.runs=6",
        folder=tmp_path,
    )
    one, two = (numbers(tracker(result, name)["metrics"]) for name in "ab")
    assert one == pytest.approx(two, rel=1e-12)
    assert one[".position_rmse.value"] > 0
    assert 0 < one[".coverage.value"] < 1, "some objects were not seen at first"
    for field in ("px_m", "vy_mps", "nees"):
        estimates = [column(result.tables["estimates"], field, tracker=name) for name in "ab"]
        np.testing.assert_allclose(*estimates, rtol=1e-12)


def test_a_tracker_reads_its_sensors_alone(run_tiny: Run) -> None:
    lidar_only = "trackers.ekf.sensors=[lidar]"
    quiet, loud = (run_tiny(lidar_only, f"sensors.radar.range_sigma_m={sigma}") for sigma in (0.1, 9))
    assert quiet.summary.fingerprint != loud.summary.fingerprint
    assert numbers(tracker(quiet, "ekf")) == numbers(tracker(loud, "ekf"))
    assert numbers(tracker(quiet, "raw")) != numbers(tracker(loud, "raw"))
    nis = quiet["ekf"].metrics
    assert nis["nis.radar"].value is None
    assert nis["nis.radar"].reason
    assert nis["nis.lidar"].dof == 2
    # Its estimates still come at every instant, those of the radar included.
    assert len(column(quiet.tables["estimates"], "px_m", tracker="ekf", object="v1")) == 21


def test_settling_time_is_left_out(run_tiny: Run, tiny_result: Result) -> None:
    settled = run_tiny("score.settle_s=1")
    counts = column(settled.tables["steps"], "count", tracker="ekf")
    np.testing.assert_array_equal(counts > 0, np.arange(21) >= 10)
    before, after = (tracker(result, "ekf")["metrics"] for result in (tiny_result, settled))
    assert after["velocity_rmse"]["value"] < 0.5 * before["velocity_rmse"]["value"]
    time = column(tiny_result.tables["steps"], "time_s", tracker="ekf")
    assert time[10] == pytest.approx(1.0)


def test_diverged_runs_are_counted(run_tiny: Run, tiny_result: Result) -> None:
    worst = np.nanmax(column(tiny_result.tables["steps"], "position_rmse_m", tracker="raw"))
    assert tracker(tiny_result, "raw")["health"]["diverged_runs"] == 0
    strict = run_tiny(f"score.divergence_m={0.1 * worst}")
    assert tracker(strict, "raw")["health"]["diverged_runs"] == 4
    assert column(strict.tables["runs"], "diverged", tracker="raw").sum() == 4


def test_coverage_is_the_share_of_the_steps_with_an_estimate(run_tiny: Run, tiny_result: Result) -> None:
    # Both start from two measurements, and so have no estimate at the first instant.
    count = column(tiny_result.tables["steps"], "given", tracker="ekf")
    assert tracker(tiny_result, "ekf")["metrics"]["coverage"]["value"] == pytest.approx(count.sum() / (21 * 2 * 4))
    first = run_tiny("trackers.ekf.initial=first_measurement")
    assert tracker(first, "ekf")["metrics"]["coverage"]["value"] == 1.0
    truth = run_tiny("trackers.ekf.initial=truth", "sensors.radar.detection_probability=0.5")
    assert tracker(truth, "ekf")["failed"] is None


@pytest.mark.parametrize(
    ("expectation", "value", "passed"),
    [
        ("metric: position_rmse, below: 1", 0.2, True),
        ("metric: position_rmse, below: 0.01", 0.2, False),
        ("metric: rmse.vx, above: 0.01", 5, True),
        ("metric: rmse.vx, above: 100", 5, False),
        ("metric: nees.mean, above: 1", 4, True),
        ("metric: nees.verdict, is: undecided", "undecided", True),
        ("metric: nees.verdict, is: consistent", "undecided", False),
        ("metric: nis.radar.inside95, above: 0.5", 0.95, True),
        ("metric: whiteness.lidar, below: 1", 0, True),
        ("metric: coverage, above: 0.9", 0.95, True),
        ("metric: health.diverged_runs, below: 1", 0, True),
        ("metric: health.non_finite_estimates, below: 0", 0, False),
        ("metric: position_rmse, better_than: raw", 0.2, True),
        ("metric: velocity_rmse, better_than: twin", 5, False),
        ("metric: velocity_rmse, below: 90", 5, True),
    ],
)  # fmt: skip
def test_expectations(expected: Result, expectation: str, value: Any, passed: bool) -> None:
    entries = {entry["name"]: entry for entry in expected.json()["trackers"]}
    stated = next(item for item in expected.json()["expectations"] if item["text"].startswith(text_of(expectation)))
    assert stated["passed"] is passed
    assert stated["tracker"] == "ekf"
    assert stated["metric"] in expectation
    assert stated["undecided"] is (value == "undecided" and not passed)
    if isinstance(value, str):
        assert stated["value"] == value
    else:
        assert stated["value"] == pytest.approx(value, rel=1, abs=0.5)
        assert stated["value"] in numbers(entries["ekf"]).values()


def text_of(expectation: str) -> str:
    metric, rest = expectation.removeprefix("metric: ").split(", ")
    operator, limit = rest.split(": ")
    return f"ekf {metric} {operator.replace('_', ' ')} {limit}"


@pytest.fixture(scope="module")
def expected(run_tiny: Run, request: pytest.FixtureRequest) -> Result:
    mark = next(mark for mark in test_expectations.pytestmark if mark.name == "parametrize")
    stated = ", ".join(f"{{tracker: ekf, {case[0]}}}" for case in mark.args[1])
    twin = "trackers.twin={filter: ekf, motion: cv, acceleration_sigma_mps2: 3}"
    result = run_tiny(twin, f"expect=[{stated}]", "monte_carlo.runs=8")
    assert result.json()["passed"] is False
    json.loads(json_text(result.json()), parse_constant=pytest.fail)
    return result


def test_one_run_of_a_second_shows_no_difference(run_tiny: Run) -> None:
    result = run_tiny("monte_carlo.runs=1", "truth.duration_s=1.5", "expect=[]", "score.min_coverage=0")
    assert {item.verdict for item in result.differences if item.metric == "position_rmse"} == {"undecided"}
    metric = tracker(result, "ekf")["metrics"]["position_rmse"]
    assert metric["ci95"] is None
    assert metric["reason"] == "too short for an interval"
    json.loads(json_text(result.json()), parse_constant=pytest.fail)


def test_an_expectation_of_what_is_not_there_fails(tiny_result: Result) -> None:
    stated = Expectation(tracker="raw", metric="nis.radar.mean", below=1e9)
    (judged,) = evaluated.judge([stated], [tiny_result["raw"]], [], 0.9)
    assert (judged.value, judged.passed) == (None, False)
    rival = Expectation(tracker="raw", metric="position_rmse", better_than="failed")
    assert not evaluated.judge([rival], [tiny_result["raw"]], [], 0.9)[0].passed


def test_better_than_is_decided_by_the_corrected_difference(tiny_result: Result) -> None:
    """As the tables show it: whichever of the two is named first, and not where none is shown."""
    fields = {
        "a": "raw",
        "b": "ekf",
        "metric": "position_rmse",
        "unit": "m",
        "value": 0.1,
        "ci95": (0.01, 0.2),
        "margin": 0.005,
    }
    shown = Difference(**fields, p_value=0.01, better="ekf", verdict="ekf better")
    not_shown = Difference(**fields, p_value=0.06, better=None, verdict="undecided")
    stated = Expectation(tracker="ekf", metric="position_rmse", better_than="raw")
    untested = Difference(**{**fields, "ci95": None}, p_value=1, better=None, verdict="undecided")
    not_counted = Difference(**fields, p_value=0.01, better=None, verdict="larger", without_charged=-0.1)
    withheld = "smaller, but not without the charge for missing estimates"
    for difference, passed, said in (
        (shown, True, ""),
        (not_shown, False, " (difference -0.1 m, undecided, p = 0.06 in the test for more than the margin)"),
        (untested, False, " (difference -0.1 m, too few runs or scenes to test)"),
        (not_counted, False, f" (difference -0.1 m, {withheld}, p = 0.01 in the test for more than the margin)"),
    ):
        (judged,) = evaluated.judge([stated], [tiny_result["ekf"]], [difference], 0.9)
        assert judged.undecided is (difference in (not_shown, untested))
        assert (judged.passed, judged.text) == (passed, f"ekf position_rmse better than raw{said}")


def test_the_chosen_run_is_shown(run_tiny: Run, tiny_result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    settled = "score.settle_s=0.3"
    shown = run_tiny("recording.run=3", settled)
    assert (shown.json()["recorded_run"], tiny_result.json()["recorded_run"]) == (3, 0)
    assert not shown.tables["measurements"].equals(tiny_result.tables["measurements"])
    # Each run's table of errors agrees with the estimates of the run that is shown.
    for result, run in ((shown, 3), (run_tiny(settled), 0)):
        error = column(result.tables["estimates"], "position_error_m", tracker="ekf")
        error = error[column(result.tables["estimates"], "time_s", tracker="ekf") > 0.25]
        rmse = column(result.tables["runs"], "position_rmse_m", tracker="ekf")[run]
        assert np.sqrt(np.nanmean(error**2)) == pytest.approx(rmse, rel=1e-12)
    monkeypatch.setattr(work, "BATCH_SIZE", 4)
    assert run_tiny("recording.run=3", settled).tables["estimates"].equals(shown.tables["estimates"])


def test_an_object_that_is_never_seen(run_tiny: Run) -> None:
    """Two cars before the ego car; the sensors see as far as the nearer one."""
    result = run_tiny("sensors.radar.max_range_m=30", "sensors.lidar.max_range_m=30")
    measurements = result.tables["measurements"]
    seen = {name: column(measurements, "valid", object=name).any() for name in result.json()["truth"]["objects"]}
    assert sorted(seen.values()) == [False, True], "the scene does not fit this test"
    hidden = next(name for name, was_seen in seen.items() if not was_seen)
    for name in ("raw", "ekf"):
        assert tracker(result, name)["failed"] is None
        assert tracker(result, name)["metrics"]["coverage"]["value"] > 0.9
        assert np.isnan(column(result.tables["estimates"], "px_m", tracker=name, object=hidden)).all()
    assert column(result.tables["steps"], "count", tracker="ekf").max() == 4


def test_differences_are_paired_and_of_every_pair(run_tiny: Run) -> None:
    ukf = "trackers.ukf={filter: ukf, motion: cv, acceleration_sigma_mps2: 3}"
    result = run_tiny(ukf, "monte_carlo.runs=8", "score.settle_s=0.5")
    pairs = [(item.a, item.b) for item in result.differences if item.metric == "position_rmse"]
    assert pairs == [("raw", "ekf"), ("raw", "ukf"), ("ekf", "ukf")]
    values = {entry["name"]: entry["metrics"]["position_rmse"]["value"] for entry in result.json()["trackers"]}
    for item in result.differences:
        if item.metric == "position_rmse":
            assert item.value == pytest.approx(values[item.a] - values[item.b], rel=1e-12)
        else:
            # No expectation names it, so it is in no family.
            assert (item.better, item.verdict, item.p_value) == (None, None, None)
    found = {(i.a, i.b): i.verdict for i in result.differences if i.metric == "position_rmse"}
    compared = ["position_rmse", "velocity_rmse", "rmse.px", "rmse.py", "rmse.vx", "rmse.vy"]
    assert list(dict.fromkeys(item.metric for item in result.differences)) == compared
    assert found["raw", "ekf"] == "ekf better"
    assert result.json()["ranking"][-1] == "raw"


def test_the_result_says_what_was_run(tiny_result: Result) -> None:
    summary = tiny_result.json()
    described = {entry["name"]: entry["describe"] for entry in summary["trackers"]}
    ekf = "ekf, cv, acceleration sigma 3 m/s^2, initial: two_measurements with least time 0 s, all sensors"
    assert described == {"raw": "raw, all sensors", "ekf": ekf}
    assert summary["truth"] | {"steps": 21, "dt": 0.1, "duration_s": 2.0, "objects": ["v1", "v2"]} == summary["truth"]
    assert summary["sensors"]["lidar"]["rate_hz"] == 5
    assert 0.7 < summary["sensors"]["lidar"]["detection_rate"] < 1
    assert summary["sensors"]["radar"]["detection_rate"] == 1
    assert set(summary["versions"]) >= {"python", "trackbench", "highway-env", "numpy"}
