"""Which runs may be held against each other, and what their differences are."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy import stats
from trackbench.compare.grounds import grounds
from trackbench.compare.regression import ERROR, FAILED, PASSED, UNDECIDED, Limit
from trackbench.compare.stored import StoredRun

from trackbench import results
from trackbench.compare import differences, regression, stored
from trackbench.compare.differences import NO_DIFFERENCE
from trackbench.errors import InputError
from trackbench.metrics.intervals import paired, ratio, unpaired
from trackbench.results import Result

Run = Callable[..., Result]
Keep = Callable[..., StoredRun]

WORSE_EKF = "trackers.ekf.acceleration_sigma_mps2=30"
TWIN = "trackers.twin={filter: ekf, motion: cv, acceleration_sigma_mps2: 3}"
RANDOM = "truth={source: scripted, duration_s: 2, rate_hz: 10, objects: {a: {pieces: [{white: {motion: cv, acceleration_sigma_mps2: 1}}]}}}"  # noqa: E501


@pytest.fixture(scope="module")
def keep(run_tiny: Run, tmp_path_factory: pytest.TempPathFactory) -> Keep:
    """Runs the tiny scenario with other values, saves the result and loads it for a comparison; once for each."""
    known: dict[tuple[str, ...], StoredRun] = {}

    def call(*overrides: str) -> StoredRun:
        if overrides not in known:
            folder = tmp_path_factory.mktemp("runs") / "tiny"
            run_tiny("monte_carlo.runs=12", *overrides).save(folder, {})
            known[overrides] = stored.load(folder)
        return known[overrides]

    return call


def test_the_trackers_of_a_run_differ_as_its_result_says(run_tiny: Run, tmp_path: Path) -> None:
    result = run_tiny("monte_carlo.runs=12", TWIN, WORSE_EKF)
    result.save(tmp_path / "tiny", {})
    metrics = ("position_rmse", "velocity_rmse")
    found = differences.compare([stored.load(tmp_path / "tiny" / "result.json")], metrics)
    stated = {(d["metric"], frozenset((d["a"], d["b"]))): d for d in result.json()["differences"]}
    assert len(found.differences) == len(stated) == 6
    for item in found.differences:
        expected = stated[item.metric, frozenset((item.entrant.tracker, item.against.tracker))]
        sign = 1 if expected["a"] == item.entrant.tracker else -1
        assert item.paired
        assert item.difference == pytest.approx(sign * expected["value"], rel=1e-9)
        assert sorted(item.ci95 or ()) == pytest.approx(sorted(sign * end for end in expected["ci95"]), rel=1e-6)
        assert item.p_value == pytest.approx(expected["p_value"], rel=1e-6, abs=1e-12)
        assert (item.verdict == NO_DIFFERENCE) == (expected["verdict"] == NO_DIFFERENCE)


@pytest.mark.parametrize("metric", sorted(stored.COLUMNS))
def test_every_metric_comes_back_from_the_table_of_the_runs(keep: Keep, metric: str) -> None:
    run = keep()
    node: Any = run.summary.trackers[1].metrics
    for part in metric.split("."):
        node = node[part]
    interval = run.interval(run.summary.trackers[1].name, metric)
    assert interval is not None
    assert interval.value == pytest.approx(node["value"], rel=1e-9)
    assert interval.ci95 == pytest.approx(node["ci95"], rel=1e-6)


def test_equal_measurements_are_paired_and_what_did_not_change_is_the_same(keep: Keep) -> None:
    base, later = keep(), keep(WORSE_EKF)
    assert grounds(base, later).paired
    found = {item.entrant.tracker: item for item in differences.compare([base, later], ["position_rmse"]).differences}
    assert found["raw"].identical
    assert (found["raw"].difference, found["raw"].verdict) == (0.0, NO_DIFFERENCE)
    assert found["ekf"].verdict == "worse"
    own, other = (run.interval("ekf", "position_rmse") for run in (later, base))
    assert own is not None
    assert other is not None
    assert found["ekf"].ci95 == paired(own, other).ci95


@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        ("monte_carlo.seed=8", "seed 8 here and 7 there"),
        ("monte_carlo.runs=20", "runs 20 here and 12 there"),
        ("name=other", "name other here and tiny there"),
    ],
)
def test_other_noise_is_compared_unpaired(keep: Keep, setting: str, reason: str) -> None:
    found = grounds(keep(), keep(setting))
    assert (found.paired, found.reason) == (False, reason)
    for item in differences.compare([keep(), keep(setting)], ["position_rmse"]).differences:
        own, other = (run.interval(item.entrant.tracker, item.metric) for run in (keep(setting), keep()))
        assert own is not None
        assert other is not None
        assert (item.paired, item.ci95) == (False, unpaired(own, other).ci95)


@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        ("truth.seed=3", "another scenario: truth.seed is 3 here and 1 there"),
        ("truth.duration_s=1", "another scenario: truth.duration_s is 1.0 here and 2.0 there"),
        ("truth.targets={nearest: 1}", "another scenario: truth.targets.nearest is 1 here and 2 there"),
        ("sensors.radar.range_sigma_m=0.4", "another scenario: sensors.radar.range_sigma_m is 0.4 here and 0.3 there"),
        ("sensors.extra={type: lidar, rate_hz: 5, position_sigma_m: 1}", "another scenario: sensors.extra is "),
        ("score.settle_s=1", "another scenario: score.settle_s is 1.0 here and 0 there"),
    ],
)
def test_runs_that_are_not_comparable_are_refused_with_the_reason(keep: Keep, setting: str, reason: str) -> None:
    base, later = keep(), keep(setting)
    with pytest.raises(InputError) as caught:
        differences.compare([base, later], ["position_rmse"])
    assert str(caught.value).startswith(f"{later.label}: cannot be compared with {base.label}: {reason}")


@pytest.mark.parametrize("setting", ["description=other", "score.divergence_m=1", "monte_carlo.runs=12"])
def test_what_bears_on_no_error_may_differ(keep: Keep, setting: str) -> None:
    assert grounds(keep(), keep(setting)).paired


def changed(run: StoredRun, folder: Path, **fields: Any) -> Path:
    """A copy of a run with other fields in its result."""
    original = Path(run.label)
    result = results.Result.load(original)
    result.summary.update(fields)
    result.save(folder, {})
    return folder


def test_another_motion_of_the_same_scenario_is_refused(keep: Keep, tmp_path: Path) -> None:
    """As another version of the simulator gives it; equal fingerprints would not excuse it."""
    base = keep()
    folder = changed(base, tmp_path / "moved", versions={**base.summary.versions, "highway-env": "0.1"})
    table = pq.read_table(folder / "truth.parquet")
    moved = pa.array(np.asarray(table["px_m"]) + 0.01)
    pq.write_table(table.set_column(table.schema.get_field_index("px_m"), "px_m", moved), folder / "truth.parquet")
    with pytest.raises(InputError, match=r"the same scenario moved differently \(highway-env 0\.1 here and"):
        grounds(base, stored.load(folder))


def test_random_motion_may_differ_with_the_seed(keep: Keep) -> None:
    base = keep(RANDOM)
    assert grounds(base, keep(RANDOM, WORSE_EKF)).paired
    assert grounds(base, keep(RANDOM, "monte_carlo.seed=8")).reason == "seed 8 here and 7 there"


def test_equal_seeds_are_not_taken_for_equal_measurements(keep: Keep, tmp_path: Path) -> None:
    base = keep()
    versions = {**base.summary.versions, "numpy": "1.0"}
    found = grounds(base, stored.load(changed(base, tmp_path / "run", fingerprint="sha256:0", versions=versions)))
    assert not found.paired
    assert found.reason.startswith("numpy 1.0 here and ")


def test_one_tracker_each_is_compared_whatever_its_name(keep: Keep) -> None:
    found = differences.compare([keep(TWIN), keep(TWIN, WORSE_EKF)], ["position_rmse"], ["twin"])
    assert [item.identical for item in found.differences] == [True]
    first = keep("trackers={old: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3}}")
    second = keep("trackers={new: {filter: ekf, motion: cv, acceleration_sigma_mps2: 30}}")
    (item,) = differences.compare([first, second], ["position_rmse"]).differences
    assert (item.entrant, item.against) == ((1, "new"), (0, "old"))
    assert item.verdict == "worse"


def test_trackers_of_one_run_only_are_named(keep: Keep) -> None:
    found = differences.compare([keep(), keep(TWIN)], ["position_rmse"])
    assert {item.entrant.tracker for item in found.differences} == {"raw", "ekf"}
    assert found.notes == (f"in {keep(TWIN).label} alone, so not compared: twin",)
    lonely = keep("trackers={other: {use: raw}}")
    with pytest.raises(InputError, match="nothing to compare: no tracker of the same name"):
        differences.compare([keep(), lonely], ["position_rmse"])


def test_p_values_are_corrected_for_all_differences_of_a_metric(keep: Keep) -> None:
    one = differences.compare([keep(), keep(WORSE_EKF)], ["position_rmse"], ["ekf"])
    two = differences.compare([keep(), keep(WORSE_EKF)], ["position_rmse"])
    assert two.differences[0].p_value == pytest.approx(2 * one.differences[0].p_value)


def test_one_run_shows_no_difference(keep: Keep) -> None:
    found = differences.compare([keep("monte_carlo.runs=1")], ["position_rmse"])
    assert [(item.ci95, item.verdict) for item in found.differences] == [(None, NO_DIFFERENCE)]
    assert "one run gives no interval and shows no difference" in found.notes


def test_welch_agrees_with_scipy() -> None:
    random = np.random.default_rng(5)
    a, b = random.normal(1.0, 0.3, size=30), random.normal(1.2, 1.0, size=12)
    expected = stats.ttest_ind(a, b, equal_var=False)
    found = unpaired(ratio(a, np.ones(30)), ratio(b, np.ones(12)))
    assert found.p_value == pytest.approx(expected.pvalue, rel=1e-6)
    assert found.ci95 == pytest.approx(tuple(expected.confidence_interval()), rel=1e-6)
    assert unpaired(ratio(a[:1], np.ones(1)), ratio(b, np.ones(12)))[1:] == (None, 1.0)


def test_rounding_is_no_difference() -> None:
    a = ratio(np.array([1.0, 2.0, 3.0]), np.ones(3))
    b = a._replace(value=a.value + 1e-13, influence=a.influence + np.array([1e-17, -1e-17, 0.0]))
    assert paired(a, b).p_value == 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trackers": 3}, "result.json: not the result of a run: trackers: "),
        ({"scenario": {"name": "x"}}, "result.json: not the result of a run: scenario.text: "),
        ({"runs": 0}, "result.json: not the result of a run: runs: "),
        ({"runs": 11}, "runs.parquet does not hold the 11 runs of"),
        ({"ranking": ["raw"]}, "not the result of a run: ranking does not name its trackers"),
        ({"scenario": {"name": "x", "text": "a: 1"}}, "its scenario is not one that this version reads: "),
    ],
)
def test_a_foreign_result_is_refused_in_one_line(
    keep: Keep, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    folder = changed(keep(), tmp_path / "run", **change)
    with pytest.raises(InputError) as caught:
        differences.compare([stored.load(folder)], ["position_rmse"])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_table_of_another_run_is_noticed(keep: Keep, tmp_path: Path) -> None:
    folder = changed(keep(), tmp_path / "run")
    results_of_other = Path(keep(WORSE_EKF).label) / "runs.parquet"
    (folder / "runs.parquet").write_bytes(results_of_other.read_bytes())
    with pytest.raises(InputError, match="they are not of the same run"):
        differences.compare([stored.load(folder)], ["position_rmse"])


@pytest.mark.parametrize("name", ["runs", "truth"])
def test_a_missing_or_damaged_table_is_told(keep: Keep, tmp_path: Path, name: str) -> None:
    folder = changed(keep(), tmp_path / "run")
    (folder / f"{name}.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=rf"{name}\.parquet: not a readable result"):
        stored.load(folder)
    (folder / f"{name}.parquet").unlink()
    with pytest.raises(InputError, match=rf"no {name}\.parquet beside result\.json"):
        stored.load(folder)


def judged(runs: list[StoredRun], percent: float, trackers: list[str] | None = None) -> dict[str, str]:
    limit = Limit("position_rmse", percent)
    regression.require_judgeable(runs, trackers)
    found = regression.judge(differences.compare(runs, [limit.metric], trackers), [limit])
    return {item.entrant.tracker: item.outcome for item in found}


def test_a_regression_fails_when_it_is_real_and_more_than_allowed(keep: Keep) -> None:
    runs = [keep(), keep(WORSE_EKF)]
    (item,) = differences.compare(runs, ["position_rmse"], ["ekf"]).differences
    assert item.percent is not None
    assert item.ci95 is not None
    assert judged(runs, item.percent - 1) == {"ekf": FAILED, "raw": PASSED}
    reach = 100 * item.ci95[1] / item.reference
    assert judged(runs, (item.percent + reach) / 2)["ekf"] == UNDECIDED
    assert judged(runs, reach + 1)["ekf"] == PASSED
    assert judged(runs[::-1], 0) == {"ekf": PASSED, "raw": PASSED}


def test_chance_does_not_fail_a_build_but_is_told(keep: Keep) -> None:
    """Other noise and few runs: a difference of a few percent that is none."""
    found = judged([keep(), keep("monte_carlo.seed=8")], 0)
    assert FAILED not in found.values()
    assert UNDECIDED in found.values()


def test_a_tracker_that_fails_now_is_an_error(keep: Keep) -> None:
    broken = keep("trackers.ekf={use: 'math:pi'}")
    assert broken.failure("ekf")
    assert judged([keep(), broken], 5) == {"raw": PASSED, "ekf": ERROR}
    assert judged([broken, keep()], 5) == {"raw": PASSED, "ekf": UNDECIDED}


def test_no_regression_passes_unseen(keep: Keep) -> None:
    cases = {
        "needs two runs": ([keep()], None),
        "a single run gives no interval": ([keep("monte_carlo.runs=1"), keep("monte_carlo.runs=1")], None),
        "no tracker 'twin', which the baseline has": ([keep(TWIN), keep()], None),
    }
    for message, (runs, trackers) in cases.items():
        with pytest.raises(InputError, match=message):
            judged(runs, 5, trackers)
    assert judged([keep(TWIN), keep()], 5, ["ekf", "raw"]) == {"ekf": PASSED, "raw": PASSED}


@pytest.mark.parametrize(
    "text", ["", "position_rmse", "position_rmse:", "position_rmse:-1", "position_rmse:nan", "x:5"]
)
def test_limits_that_are_none(text: str) -> None:
    with pytest.raises(InputError, match="--fail-on-regression"):
        regression.parse(text)


def test_limits() -> None:
    assert regression.parse("rmse.px:2.5") == regression.parse("rmse.px:2.5%") == Limit("rmse.px", 2.5)


def test_json_of_a_result_has_no_nan(keep: Keep) -> None:
    from trackbench.report import compared

    outcome = differences.compare(
        [keep("monte_carlo.runs=1"), keep("monte_carlo.runs=1", WORSE_EKF)], ["position_rmse"]
    )
    text = json.dumps(compared.to_json(outcome, []), allow_nan=False)
    assert json.loads(text)["differences"][0]["ci95"] is None
