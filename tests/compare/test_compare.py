"""Which results may be compared, and what their differences are."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats
from tests.support.results import with_tables

from trackbench.base.errors import InputError
from trackbench.compare import (
    Comparison,
    Entrant,
    Limit,
    PairDifference,
    ResultSet,
    compare_results,
    find_results,
    load_comparison,
)
from trackbench.compare.comparability import Comparability, comparability, compared_metrics
from trackbench.document import Paragraph
from trackbench.metrics import BUILT_IN, Metric
from trackbench.metrics.contrasts import paired, unpaired
from trackbench.metrics.differences import EQUIVALENT, UNDECIDED, holm
from trackbench.metrics.intervals import ratio
from trackbench.report.comparison.sentences import answer_blocks
from trackbench.results import Result

Run = Callable[..., Result]
Keep = Callable[..., ResultSet]

METRICS = compared_metrics([], built_in=True)
COMPARED = [metric.name for metric in BUILT_IN if metric.compared and metric.better]
POSITION = METRICS["position_rmse"]
WORSE_EKF = "trackers.ekf.acceleration_sigma_mps2=30"
TWIN = (
    "trackers.twin={filter: ekf, motion: cv, acceleration_sigma_mps2: 3, "
    "initial: {from: two_measurements, least_time_s: 0}}"
)
RANDOM = "truth={source: scripted, duration_s: 2, rate_hz: 10, objects: {a: {pieces: [{white: {motion: cv, acceleration_sigma_mps2: 1}}]}}}"  # noqa: E501


@pytest.fixture(scope="module")
def ran(run_tiny: Run) -> Run:
    """The result of 12 runs of the tiny scenario with other values; once for each."""
    return cache(partial(run_tiny, "monte_carlo.runs=12"))


@pytest.fixture(scope="module")
def keep(ran: Run, tmp_path_factory: pytest.TempPathFactory) -> Keep:
    """The same result, saved and found for a comparison; once for each."""

    @cache
    def call(*overrides: str) -> ResultSet:
        folder = tmp_path_factory.mktemp("runs") / "tiny"
        ran(*overrides).save(folder, {})
        return find_results(folder)

    return call


def how(baseline: ResultSet, later: ResultSet) -> Comparability:
    return comparability(baseline.entries[0], later.entries[0])


def by_tracker(comparison: Comparison) -> dict[str, PairDifference]:
    return {item.entrant.tracker: item for item in comparison.differences}


def test_the_trackers_of_a_run_differ_as_its_result_says(ran: Run, keep: Keep) -> None:
    result, file = ran(TWIN, WORSE_EKF), Path(keep(TWIN, WORSE_EKF).label) / "result.json"
    found = compare_results([find_results(file)], metrics=COMPARED)
    stated = {(d.metric, frozenset((d.a, d.b))): d for d in result.differences}
    assert len(found.differences) == len(stated) == 18
    for item in found.differences:
        expected = stated[item.metric, frozenset((item.entrant.tracker, item.against.tracker))]
        sign = 1 if expected.a == item.entrant.tracker else -1
        assert item.paired_runs == 12
        assert item.difference == pytest.approx(sign * expected.value, rel=1e-9)
        assert expected.ci95 is not None
        assert sorted(item.ci95 or ()) == pytest.approx(sorted(sign * end for end in expected.ci95 or ()), rel=1e-6)
        assert item.margin == pytest.approx(expected.margin)
        if item.metric != "position_rmse":
            assert expected.p_value is None
    # By the metric that ranks alone the family is the same.
    alone = compare_results([find_results(file)]).differences
    assert {item.metric for item in alone} == {"position_rmse"}
    for item in alone:
        expected = stated[item.metric, frozenset((item.entrant.tracker, item.against.tracker))]
        assert item.p_value == pytest.approx(expected.p_value, rel=1e-6, abs=1e-12)
        assert (item.verdict in ("better", "worse")) == (expected.better is not None)
        assert (item.verdict == EQUIVALENT) == (expected.verdict == EQUIVALENT)
    together = [item for item in found.differences if item.metric == "position_rmse"]
    assert all(one.p_value <= several.p_value for one, several in zip(alone, together, strict=True))


@pytest.mark.parametrize("metric", sorted(METRICS))
def test_every_metric_comes_back_from_the_table_of_the_runs(keep: Keep, metric: str) -> None:
    (entry,) = keep().entries
    tracker = entry.result.summary.trackers[1]
    stated = tracker.metrics[metric.removesuffix(".mean")]
    interval = entry.interval(tracker.name, METRICS[metric])
    assert interval is not None
    assert interval.value == pytest.approx(stated.value, rel=1e-9)
    assert interval.ci95 == (stated.ci95 and pytest.approx(stated.ci95, rel=1e-6))


def test_equal_measurements_are_paired_and_what_did_not_change_is_the_same(keep: Keep) -> None:
    base, later = keep(), keep(WORSE_EKF)
    found = by_tracker(compare_results([base, later]))
    assert found["raw"].identical
    assert (found["raw"].difference, found["raw"].verdict) == (0.0, EQUIVALENT)
    assert found["ekf"].verdict == "worse"
    assert found["ekf"].paired_runs == 12
    own, other = (item.entries[0].interval("ekf", POSITION) for item in (later, base))
    assert own is not None
    assert other is not None
    assert found["ekf"].ci95 == paired(own, other).ci95


@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        ("monte_carlo.seed=8", "seed 8 here and 7 there"),
        ("name=other", "name other here and tiny there"),
    ],
)
def test_other_noise_is_compared_unpaired(keep: Keep, setting: str, reason: str) -> None:
    found = how(keep(), keep(setting))
    assert (found.shared, found.reason) == (None, reason)
    for item in compare_results([keep(), keep(setting)]).differences:
        own, other = (part.entries[0].interval(item.entrant.tracker, POSITION) for part in (keep(setting), keep()))
        assert own is not None
        assert other is not None
        assert (item.paired_runs, item.ci95) == (None, unpaired(own, other).ci95)


def test_runs_of_several_scenes_are_paired_scene_by_scene(keep: Keep) -> None:
    """A run is the same whatever the number of runs in each scene; the scenes are what is independent."""
    scenes = "truth.seeds=5"
    base, longer = keep(scenes, "monte_carlo.runs=4"), keep(scenes, "monte_carlo.runs=6", WORSE_EKF)
    assert how(base, longer).reason == "over the 20 runs of 30 here and 20 there with equal fingerprints"
    found = by_tracker(compare_results([base, longer]))
    assert found["raw"].identical
    same_length = by_tracker(compare_results([base, keep(scenes, "monte_carlo.runs=4", WORSE_EKF)]))["ekf"]
    assert (found["ekf"].paired_runs, found["ekf"].scenes) == (20, 5)
    assert found["ekf"].ci95 == pytest.approx(same_length.ci95, rel=1e-9)
    own = base.entries[0].interval("ekf", POSITION)
    assert own is not None
    assert len(own.influence) == 5


def test_more_runs_are_paired_over_those_that_both_have(keep: Keep) -> None:
    """The run with a number is the same however many there are."""
    longer = keep("monte_carlo.runs=20", WORSE_EKF)
    found = compare_results([keep(), longer], metrics=["position_rmse", "position_over_reference"])
    (_, later) = found.scenarios[0].results
    assert later.shared_runs == 12
    assert later.reason == "over the 12 runs of 20 here and 12 there with equal fingerprints"
    position = {d.entrant.tracker: d for d in found.differences if d.metric == "position_rmse"}
    assert position["raw"].identical
    same_length = by_tracker(compare_results([keep(), keep(WORSE_EKF)]))["ekf"]
    assert position["ekf"].ci95 == pytest.approx(same_length.ci95, rel=1e-9)
    assert {d.paired_runs for d in found.differences if d.metric == "position_over_reference"} == {12}


@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        ("truth.duration_s=1", "another scenario: truth.duration_s is 1.0 here and 2.0 there"),
        ("truth.targets={nearest: 1}", "another scenario: truth.targets.nearest is 1 here and 2 there"),
        ("sensors.radar.range_sigma_m=0.4", "another scenario: sensors.radar.range_sigma_m is 0.4 here and 0.3 there"),
        ("sensors.extra={type: lidar, rate_hz: 5, position_sigma_m: 1}", "another scenario: sensors.extra is "),
        ("score.settle_s=1", "another scenario: score.settle_s is 1.0 here and 0.0 there"),
    ],
)
def test_results_that_are_not_comparable_are_refused_with_the_reason(ran: Run, setting: str, reason: str) -> None:
    base = ran()
    scenario = base.summary.scenario
    later = base.updated(scenario=scenario.model_copy(update={"overrides": [*scenario.overrides, setting]}))
    with pytest.raises(InputError) as caught:
        compare_results([base, later])
    assert str(caught.value).startswith(f"results 2: cannot be compared with results 1: {reason}")


def test_what_bears_on_no_error_may_differ(keep: Keep) -> None:
    assert how(keep(), keep("description=other", "score.divergence_m=1", "monte_carlo.runs=12")).shared is not None


def changed(run: ResultSet, folder: Path, **fields: Any) -> Path:
    """A copy of a run's folder with other fields in its result.json."""
    shutil.copytree(run.label, folder)
    file = folder / "result.json"
    raw = json.loads(file.read_text(encoding="utf-8"))
    for key, value in fields.items():
        raw[key] = {**raw[key], **value} if isinstance(value, dict) else value
    file.write_text(json.dumps(raw), encoding="utf-8")
    return folder


def test_another_motion_of_the_same_scenario_is_refused(keep: Keep, tmp_path: Path) -> None:
    """As another version of the simulator gives it; equal fingerprints would not excuse it."""
    base = keep()
    folder = tmp_path / "moved"
    result = Result.load(changed(base, tmp_path / "copy", versions={"highway-env": "0.1"}))
    table = result.tables.truth
    moved = pa.array(np.asarray(table["px_m"]) + 0.01)
    table = table.set_column(table.schema.get_field_index("px_m"), "px_m", moved)
    with_tables(result, truth=table).save(folder)
    with pytest.raises(InputError, match=r"the same scenario moved differently \(highway-env 0\.1 here and"):
        how(base, find_results(folder))


def test_random_motion_may_differ_with_the_seed(keep: Keep) -> None:
    base = keep(RANDOM)
    assert how(base, keep(RANDOM, WORSE_EKF)).shared is not None
    assert how(base, keep(RANDOM, "monte_carlo.seed=8")).reason == "seed 8 here and 7 there"


def test_equal_seeds_are_not_taken_for_equal_measurements(keep: Keep, tmp_path: Path) -> None:
    base = keep()
    found = how(base, find_results(changed(base, tmp_path / "run", fingerprints=["0"] * 12, versions={"numpy": "1.0"})))
    assert found.shared is None
    assert found.reason.startswith("numpy 1.0 here and ")


def test_one_tracker_each_is_compared_whatever_its_name(keep: Keep) -> None:
    found = compare_results([keep(TWIN), keep(TWIN, WORSE_EKF)], trackers=["twin"])
    assert [item.identical for item in found.differences] == [True]
    first = keep("trackers={old: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, initial: first_measurement}}")
    second = keep("trackers={new: {filter: ekf, motion: cv, acceleration_sigma_mps2: 30, initial: first_measurement}}")
    (item,) = compare_results([first, second]).differences
    assert (item.entrant, item.against) == (Entrant(tracker="new", set=1), Entrant(tracker="old"))
    assert item.verdict == "worse"


def test_p_values_are_corrected_for_the_number_of_differences_but_not_for_identical_trackers(keep: Keep) -> None:
    one = compare_results([keep(), keep(WORSE_EKF)], trackers=["ekf"])
    beside = compare_results([keep(), keep(WORSE_EKF)])
    assert [item.identical for item in beside.differences] == [False, True]
    assert [item.p_value for item in beside.differences] == [one.differences[0].p_value, 1.0]
    names = ("position_rmse", "velocity_rmse")
    alone = [compare_results([keep(), keep(WORSE_EKF)], trackers=["ekf"], metrics=[name]) for name in names]
    two = compare_results([keep(), keep(WORSE_EKF)], trackers=["ekf"], metrics=names)
    expected = holm([item.differences[0].p_value for item in alone])
    assert [item.p_value for item in two.differences] == pytest.approx(expected)


def test_one_run_shows_no_difference(keep: Keep) -> None:
    found = compare_results([keep("monte_carlo.runs=1")])
    assert [(item.ci95, item.verdict) for item in found.differences] == [(None, UNDECIDED)]
    assert "a single run has no interval, so only its values are compared" in found.notes


def test_a_metric_of_which_neither_is_better_is_larger_or_smaller(keep: Keep) -> None:
    sets = [keep(), keep("trackers.ekf.acceleration_sigma_mps2=0.01")]
    for order, verdict in ((sets, "larger"), (sets[::-1], "smaller")):
        (item,) = compare_results(order, metrics=["nees.mean"], trackers=["ekf"]).differences
        assert (item.difference > 0, item.verdict) == (verdict == "larger", verdict)


def test_welch_agrees_with_scipy() -> None:
    random = np.random.default_rng(5)
    a, b = random.normal(1.0, 0.3, size=30), random.normal(1.2, 1.0, size=12)
    expected = stats.ttest_ind(a, b, equal_var=False)
    found = unpaired(ratio(a, np.ones(30)), ratio(b, np.ones(12)))
    assert found.p_value == pytest.approx(expected.pvalue, rel=1e-6)
    assert found.ci95 == pytest.approx(tuple(expected.confidence_interval()), rel=1e-6)
    assert unpaired(ratio(a[:1], np.ones(1)), ratio(b, np.ones(12)))[1:3] == (None, 1.0)


def judged(sets: list[ResultSet], percent: float, trackers: list[str] | None = None) -> dict[str, str]:
    found = compare_results(sets, trackers=trackers, limits=[Limit("position_rmse", percent)])
    return {item.entrant.tracker: item.outcome for item in found.gates}


def test_a_regression_fails_when_it_is_real_and_more_than_allowed(keep: Keep) -> None:
    sets = [keep(), keep(WORSE_EKF)]
    (item,) = compare_results(sets, trackers=["ekf"]).differences
    assert item.percent is not None
    assert item.ci95 is not None
    assert judged(sets, item.percent - 1) == {"ekf": "failed", "raw": "passed"}
    reach = 100 * item.ci95[1] / item.reference
    assert judged(sets, (item.percent + reach) / 2)["ekf"] == "undecided"
    assert judged(sets, reach + 1)["ekf"] == "passed"
    assert judged(sets[::-1], 0) == {"ekf": "passed", "raw": "passed"}


def test_where_larger_is_better_a_smaller_value_is_a_regression(keep: Keep, monkeypatch: pytest.MonkeyPatch) -> None:
    def larger(own: object, *, built_in: bool) -> dict[str, Metric]:
        turned = {path: type(path, (type(metric),), {"better": "larger"}) for path, metric in METRICS.items()}
        return {path: metric() for path, metric in turned.items()}

    monkeypatch.setattr(import_module("trackbench.compare.comparability"), "compared_metrics", larger)
    sets = [keep(), keep(WORSE_EKF)]
    assert judged(sets, 0)["ekf"] == "passed"
    assert judged(sets[::-1], 0)["ekf"] == "failed"


def test_chance_does_not_fail_a_build_but_is_told(keep: Keep) -> None:
    """Other noise and few runs: a difference of a few percent that is none."""
    found = judged([keep(), keep("monte_carlo.seed=8")], 0)
    assert "failed" not in found.values()
    assert "undecided" in found.values()


def test_a_tracker_that_fails_now_is_an_error(keep: Keep) -> None:
    broken = keep("trackers.ekf={use: 'math:pi'}")
    assert broken.entries[0].failure("ekf")
    assert judged([keep(), broken], 5) == {"raw": "passed", "ekf": "error"}
    assert judged([broken, keep()], 5) == {"raw": "passed", "ekf": "undecided"}
    (headline,) = answer_blocks(compare_results([keep(), broken]))
    assert isinstance(headline, Paragraph)
    assert headline.text.startswith("ekf failed in B. By position RMSE: ")


def test_no_regression_passes_unseen(keep: Keep) -> None:
    cases = {
        "needs two results": ([keep()], None),
        "2 s of a single run give no interval: record at least 8 s": (
            [keep("monte_carlo.runs=1"), keep("monte_carlo.runs=1")],
            None,
        ),
        "3 scenes give no interval of position_rmse: take 5 or more": (
            [keep("truth.seeds=3", "monte_carlo.runs=2")] * 2,
            None,
        ),
        "no tracker 'twin', which the baseline has": ([keep(TWIN), keep()], None),
    }
    for message, (sets, trackers) in cases.items():
        with pytest.raises(InputError, match=message):
            judged(sets, 5, trackers)
    assert judged([keep(TWIN), keep()], 5, ["ekf", "raw"]) == {"ekf": "passed", "raw": "passed"}


@pytest.fixture(scope="module")
def versions(keep: Keep, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The folders of two versions, each with the results of two scenarios; the later one has a worse EKF."""
    found = []
    for label, settings in (("before", ()), ("after", (WORSE_EKF,))):
        folder = tmp_path_factory.mktemp("versions") / label
        for name in ("tiny", "other"):
            shutil.copytree(keep(f"name={name}", *settings).label, folder / name)
        found.append(folder)
    return found[0], found[1]


def test_folders_of_several_scenarios_are_compared_by_scenario_and_overall(versions: tuple[Path, Path]) -> None:
    found = compare_results([find_results(path) for path in versions], limits=[Limit("position_rmse", 5)])
    assert [scenario.name for scenario in found.scenarios] == ["other", "tiny"]
    assert {result.shared_runs for scenario in found.scenarios for result in scenario.results[1:]} == {12}
    assert {(d.scenario, d.entrant.tracker): d.verdict for d in found.differences} == {
        (scenario, tracker): verdict
        for scenario in ("tiny", "other")
        for tracker, verdict in (("ekf", "worse"), ("raw", EQUIVALENT))
    }
    overall = {item.entrant.tracker: item for item in found.overall}
    assert overall["ekf"].verdicts == {"worse": 2}
    ratios = [d.value / d.reference for d in found.differences if d.entrant.tracker == "ekf"]
    assert overall["ekf"].mean_percent == pytest.approx(100 * (np.sqrt(np.prod(ratios)) - 1))
    assert overall["raw"].mean_percent == pytest.approx(0)
    assert [(item.scenario, item.outcome) for item in found.gates if item.entrant.tracker == "ekf"] == [
        ("other", "failed"),
        ("tiny", "failed"),
    ]
    # One question is asked of all scenarios, so all their differences are one family.
    alone = compare_results([find_results(path / "tiny") for path in versions], trackers=["ekf"]).differences[0]
    (both,) = [d for d in found.differences if d.scenario == "tiny" and d.entrant.tracker == "ekf"]
    assert both.p_value == pytest.approx(2 * alone.p_value)


def test_a_scenario_of_one_folder_only_is_told_and_not_passed(versions: tuple[Path, Path], tmp_path: Path) -> None:
    shutil.copytree(versions[1] / "tiny", tmp_path / "tiny")
    sets = [find_results(versions[0]), find_results(tmp_path)]
    found = compare_results(sets)
    assert [scenario.name for scenario in found.scenarios] == ["tiny"]
    assert f"in {versions[0]} alone, so not compared: scenario other" in found.notes
    with pytest.raises(InputError, match="no result of the scenario 'other', which the baseline has"):
        compare_results(sets, limits=[Limit("position_rmse", 5)])


def test_a_folder_of_several_scenarios_ranks_its_trackers(versions: tuple[Path, Path]) -> None:
    found = compare_results([find_results(versions[0])])
    assert [item.tracker for item in found.ranking] == ["ekf", "raw"]
    assert len(found.differences) == 2
    assert len(found.scenarios) == 2


def test_results_of_python_are_compared_like_folders(ran: Run, keep: Keep) -> None:
    of_folders = compare_results([keep(), keep(WORSE_EKF)])
    assert compare_results([ran(), ran(WORSE_EKF)]).differences == of_folders.differences
    named = [ran("name=tiny"), ran("name=other")]
    assert [item.tracker for item in compare_results([named]).ranking] == ["ekf", "raw"]


def test_two_results_of_one_scenario_in_a_folder(keep: Keep, tmp_path: Path) -> None:
    for name in ("a", "b"):
        shutil.copytree(keep().label, tmp_path / name)
    with pytest.raises(InputError, match=f"two results of the scenario 'tiny', here and in {tmp_path}/a"):
        find_results(tmp_path)


PLUGINS = """
import numpy as np
from trackbench.metrics import Metric, ratio

class Within(Metric):
    name, unit, meaning, better = "within", "1", "share of the estimates that are near the truth", "larger"
    limit_m: float = 0.5
    def init(self, scope):
        return np.zeros((2, scope.runs))
    def update(self, sums, chunk):
        near = np.hypot(chunk.error[0], chunk.error[1]) < self.limit_m
        return sums + [chunk.by_run(1.0), chunk.by_run(near)]
    def merge(self, blocks):
        return np.concatenate(blocks, axis=1)
    def finish(self, sums):
        return ratio(sums[1], sums[0])
"""


@pytest.fixture(scope="module")
def with_metric(
    run_tiny: Run, write_module: Callable[[Path, str], str], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[float], ResultSet]:
    """A saved result with a metric of a module that is only beside the scenario, and an expectation of it."""
    code = tmp_path_factory.mktemp("code")
    module = write_module(code, PLUGINS)

    @cache
    def call(limit: float) -> ResultSet:
        metric = f"score.metrics=[{{use: '{module}:Within', options: {{limit_m: {limit}}}}}]"
        result = run_tiny(metric, "expect=[{tracker: ekf, metric: within, above: 0}]", folder=code)
        folder = tmp_path_factory.mktemp("kept") / "tiny"
        result.save(folder, {})
        return find_results(folder)

    return call


def test_plugins_of_metrics_are_not_needed_to_compare(
    with_metric: Callable[[float], ResultSet], trackbench: str, tmp_path: Path
) -> None:
    folders = [with_metric(0.5).label, with_metric(0.5).label]
    done = subprocess.run(
        [trackbench, "compare", *folders, "--metric", "within"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "within" in done.stdout


def test_a_metric_with_other_options_is_another_metric(with_metric: Callable[[float], ResultSet]) -> None:
    base, later = with_metric(0.5), with_metric(0.1)
    assert compare_results([base, later]).differences
    with pytest.raises(InputError, match=r"another metric within: limit_m is 0\.1 here and 0\.5 there$"):
        compare_results([base, later], metrics=["within"])


def test_a_comparison_is_kept_and_loaded(keep: Keep, versions: tuple[Path, Path], tmp_path: Path) -> None:
    for sets in (
        [keep("monte_carlo.runs=1"), keep("monte_carlo.runs=1", WORSE_EKF)],
        [find_results(versions[0])],
        [find_results(path) for path in versions],
    ):
        found = compare_results(sets)
        file = tmp_path / "comparison.json"
        file.write_text(json.dumps(found.json(), allow_nan=False), encoding="utf-8")
        assert load_comparison(file).json() == found.json()
    assert "step_time" not in file.read_text(encoding="utf-8")
    assert found.scores[0].value("step_time") is not None


@pytest.mark.parametrize("text", ["", "[]", '{"schema_version": 1}', '{"schema_version": 5}', "[" * 100_000])
def test_what_is_no_comparison_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "comparison.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_comparison(file)
    assert "\n" not in str(caught.value)


def test_estimates_that_come_later_fail_a_gate_by_what_they_cost(keep: Keep) -> None:
    few, late = "score.min_coverage=0.5", "trackers.ekf.initial={from: two_measurements, least_time_s: 0.5}"
    found = compare_results([keep(few), keep(few, late)], limits=[Limit("position_rmse", 5.0)])
    assert {item.entrant.tracker: item.outcome for item in found.gates} == {"raw": "passed", "ekf": "failed"}
    (note,) = found.notes
    assert note.startswith("ekf gave 7")
    assert note.endswith("% of the estimates due in tiny, ekf 95 %")
