"""``import trackbench as tb``: what a program and a notebook use."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.figure
import matplotlib.image
import numpy as np
import pytest
from tests.runner.test_traffic_runs import SCENARIO

import trackbench as tb
import trackbench.results
from trackbench.runner.work import work_of
from trackbench.scenario.truth import truth_of
from trackbench.sensing import scans

Cli = Callable[..., Any]

SHORT = {"truth.duration_s": 2, "monte_carlo.runs": 20}


@pytest.fixture(scope="module")
def scenario() -> tb.Scenario:
    return tb.load("highway", SHORT, trackers=["raw", "ekf_cv"])


@pytest.fixture(scope="module")
def result(scenario: tb.Scenario) -> tb.Result:
    return tb.run(scenario)


def python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_every_name_is_there_and_documented() -> None:
    assert set(tb.__all__) <= set(dir(tb))
    for name in tb.__all__:
        assert getattr(tb, name).__doc__, name
    assert tb.__version__
    with pytest.raises(AttributeError, match="no attribute 'laod'"):
        _ = tb.laod  # type: ignore[attr-defined]


def test_the_import_brings_nothing_heavy() -> None:
    loaded = python("import sys, trackbench; print(*sys.modules)").split()
    heavy = {"highway_env", "matplotlib", "rerun", "scipy", "numpy", "pandas", "pyarrow", "pydantic"}
    assert not heavy & set(loaded)


@pytest.mark.parametrize("before", ["", "import trackbench.truth, trackbench.compare; ", "tb.load; "])
def test_a_function_is_not_hidden_by_the_package_of_its_name(before: str) -> None:
    after = "from trackbench.truth import LoadedTruth; import trackbench.compare"
    code = f"import trackbench as tb; {before}print(tb.truth.__name__, tb.compare.__name__); {after}; print(tb.truth)"
    first, second = python(code).splitlines()
    assert first == "truth compare"
    assert second.startswith("<function truth")


@pytest.mark.parametrize(
    "given",
    [
        {"truth.duration_s": 2, "monte_carlo.runs": 3},
        {"truth.duration_s": np.float64(2), "monte_carlo.runs": np.int64(3)},
        ["truth.duration_s=2", "monte_carlo.runs=3"],
    ],
)
def test_keys_are_set_as_on_the_command_line(given: Any) -> None:
    config = tb.load("highway", given).config
    assert (config.truth.duration_s, config.monte_carlo.runs) == (2, 3)


def test_text_stays_text_and_a_mapping_is_one(tiny: Path) -> None:
    tracker = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 1e-3}
    loaded = tb.load(
        tiny, {"trackers.new": tracker, "description": "1e-3", "trackers.raw.sensors": np.array(["lidar"])}
    )
    assert loaded.config.description == "1e-3"
    assert "0.001" in repr(loaded.config.trackers["new"])
    assert list(loaded.config.trackers["raw"].sensors or ()) == ["lidar"]


def test_runs_seed_and_trackers(tiny: Path) -> None:
    loaded = tb.load(tiny, runs=9, seed=8, trackers=["ekf"])
    assert (loaded.config.monte_carlo.runs, loaded.config.monte_carlo.seed, [*loaded.config.trackers]) == (
        9,
        8,
        ["ekf"],
    )
    assert repr(loaded) == "<scenario tiny: 1 tracker, 9 runs>"


def test_a_text_or_mapping_is_the_scenario_of_the_file(tiny: Path, tiny_text: str) -> None:
    import yaml

    of_file = tb.load(tiny).config
    assert tb.load(tiny_text).config == of_file
    assert tb.load(yaml.safe_load(tiny_text)).config == of_file


def test_a_result_is_that_of_the_command(cli: Cli, scenario: tb.Scenario, result: tb.Result, tmp_path: Path) -> None:
    """The numbers, and the files."""
    tb.run(scenario, out="api", recording=False)
    settings = [word for key, value in SHORT.items() for word in ("--set", f"{key}={value}")]
    assert cli("run", "highway", *settings, "--trackers", "raw,ekf_cv", "--no-recording").status in (0, 1)
    mine, theirs = tmp_path / "api" / "highway", tmp_path / "results" / "highway"
    assert {file.name for file in mine.iterdir()} == {file.name for file in theirs.iterdir()}
    assert tb.Result.load(mine).summary.command == tb.Result.load(theirs).summary.command
    for found in (tb.Result.load(mine), tb.Result.load(theirs)):
        assert found.summary.fingerprints == result.summary.fingerprints
        assert found["ekf_cv"].position_rmse == result["ekf_cv"].position_rmse
        assert found.tables.steps.equals(result.tables.steps)


@pytest.mark.slow
def test_several_scenarios_give_several_results(tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = tb.run(
        [tb.load(tiny), tb.load(tiny, {"name": "other", "monte_carlo.runs": 5})], out=tmp_path, recording=False
    )
    assert [item.name for item in found] == ["tiny", "other"]
    assert (tmp_path / "other" / "report.html").is_file()
    assert (tmp_path / "comparison.html").is_file()
    assert tb.compare(tmp_path).ranking[0].tracker == "ekf"
    with pytest.raises(tb.InputError, match="give each scenario its own"):
        tb.run([tiny, tiny])


def test_the_metrics_and_tables_are_at_hand(result: tb.Result) -> None:
    position = result["ekf_cv"].position_rmse
    assert position.unit == "m"
    assert 0 < position.value < result["raw"].position_rmse.value
    steps = result.to_pandas("steps")
    assert set(steps["tracker"]) == {"raw", "ekf_cv"}
    assert repr(result) == "<result highway: 20 runs, 2 trackers, best ekf_cv>"


def test_two_tunings_are_compared(scenario: tb.Scenario, result: tb.Result) -> None:
    tuned = tb.run(tb.load("highway", {**SHORT, "trackers.ekf_cv.acceleration_sigma_mps2": 30}, trackers=["ekf_cv"]))
    found = tb.compare(result, tuned, trackers=["ekf_cv"], limits={"position_rmse": 1})
    [difference] = found.differences
    assert difference.value == pytest.approx(tuned["ekf_cv"].position_rmse.value, rel=1e-12)
    assert difference.reference == pytest.approx(result["ekf_cv"].position_rmse.value, rel=1e-12)
    assert difference.paired_runs == 20
    assert not found.passed
    assert "ekf_cv" in str(found)
    assert "ekf_cv" in found._repr_html_()


def test_truth_and_scans_are_those_of_the_run(scenario: tb.Scenario) -> None:
    truth, seen = tb.truth(scenario), tb.sense(scenario, range(1, 3))
    work = work_of(scenario, [truth_of(scenario)])
    expected = scans.sense_known(work.scenes[0].sensors, work.seed, work.scenario, range(1, 3)).scans
    assert len(seen) == len(expected)
    for mine, theirs in zip(seen, expected, strict=True):
        assert mine.measurement.shape == (len(mine.noise_covariance), len(truth.ids), 2)
        for object_number in range(len(truth.ids)):
            of_object = slice(2 * object_number, 2 * object_number + 2)
            np.testing.assert_array_equal(mine.measurement[:, object_number], theirs.measurement[:, of_object])
            np.testing.assert_array_equal(mine.valid[object_number], theirs.valid[of_object])
    lidar = next(scan for scan in seen if scan.kind == "lidar")
    step = int(np.argmin(abs(truth.time - lidar.time)))
    x, _, yaw = lidar.sensor_pose
    shown = x + np.cos(yaw) * lidar.measurement[0] - np.sin(yaw) * lidar.measurement[1]
    np.testing.assert_allclose(shown[lidar.valid], np.broadcast_to(truth.px[step], shown.shape)[lidar.valid], atol=2)


def test_scans_with_hidden_identities_are_the_detections_of_one_run(tmp_path: Path) -> None:
    text = SCENARIO.partition("trackers:")[0] + "trackers: {own: {use: own:Tracker}}\nmonte_carlo: {runs: 6}\n"
    text = text.replace("    clutter: {per_scan: 2}\n", "    fov_deg: 90\n").replace(": 0.95", ": 0.2")
    scans = {}
    for identities in ("known", "hidden"):
        file = tmp_path / f"{identities}.yaml"
        file.write_text(text.replace("identities: hidden", f"identities: {identities}"), encoding="utf-8")
        scans[identities] = tb.sense(tb.load(file), range(5, 6))
    known, hidden = scans["known"], scans["hidden"]
    assert len(known) == len(hidden)
    numbers = set()
    shuffled = False
    for before, after in zip(known, hidden, strict=True):
        detections = before.measurement[:, before.valid]
        assert after.measurement.shape == detections.shape
        assert after.valid.tolist() == [True] * detections.shape[1]
        np.testing.assert_array_equal(np.sort(after.measurement[0]), np.sort(detections[0]))
        shuffled |= not np.array_equal(after.measurement, detections)
        numbers.add(detections.shape[1])
    assert shuffled
    assert 0 in numbers
    radar = next(scan for scan in hidden if scan.sensor == "radar")
    assert (radar.detection_probability, radar.clutter_density) == (0.2, 0.0)
    assert radar.field_of_view.half_angle == pytest.approx(np.pi / 4)
    with pytest.raises(tb.InputError, match="ask for one run at a time"):
        tb.sense(tb.load(file), range(2))


def test_a_notebook_shows_a_result_a_report_and_its_figures(result: tb.Result) -> None:
    assert "<td>ekf_cv</td>" in result._repr_html_()
    assert "<p>" not in result._repr_html_()
    report = result.report()
    assert report._repr_html_().startswith("<iframe srcdoc=")
    assert "&lt;h1&gt;" in report._repr_html_() or "&lt;h1" in report._repr_html_()
    assert "position RMSE" in str(report)
    assert repr(report) == "<report highway>"
    assert {"map", "errors"} <= set(result.figures)
    figure = result.figure("errors")
    assert figure._repr_svg_().startswith("<svg")
    assert repr(figure).startswith("<figure errors: ")


@pytest.mark.parametrize(
    ("ending", "files"),
    [
        ("html", {"x.html"}),
        ("md", {"x.md"}),
        ("txt", {"x.txt"}),
        ("tex", {"x-ranking.tex", "x-sensors.tex"}),
        ("csv", {"x-ranking.csv", "x-sensors.csv"}),
        ("svg", {"x-errors.svg", "x-map.svg"}),
        ("png", {"x-errors.png", "x-map.png"}),
    ],
)
def test_a_report_is_saved_by_the_ending(result: tb.Result, tmp_path: Path, ending: str, files: set[str]) -> None:
    result.report().save(tmp_path / "new" / f"x.{ending}")
    written = {file.name: file.stat().st_size for file in (tmp_path / "new").rglob("*") if file.is_file()}
    assert files <= set(written)
    assert all(written.values())


def test_a_figure_goes_on_in_matplotlib(result: tb.Result, tmp_path: Path) -> None:
    figure = result.figure("errors").to_matplotlib()
    assert isinstance(figure, matplotlib.figure.Figure)
    figure.axes[0].set_title("mine")
    # Outside the settings it was drawn in, its colours are still known.
    figure.savefig(tmp_path / "mine.png")
    red, green, blue = matplotlib.image.imread(tmp_path / "mine.png")[0, 0, :3]
    assert (red, green, blue) == (1, 1, 1)
    assert result.figure("errors").to_matplotlib() is not figure


def test_metrics_and_differences_are_data_frames(result: tb.Result) -> None:
    tidy = result.to_pandas()
    metrics = tidy[(tidy["condition"] == "") & (tidy["scene"] == "")].set_index(["tracker", "metric"])
    error = result["ekf_cv"].position_rmse
    assert tuple(metrics.loc[("ekf_cv", "position_rmse"), ["value", "low", "high"]]) == (error.value, *error.ci95)
    assert len(metrics) == sum(len(tracker.metrics) for tracker in result.summary.trackers)
    straight = tidy[(tidy["condition"] == "manoeuvre: straight") & (tidy["metric"] == "position_rmse")]
    assert straight.set_index("tracker")["value"].to_dict() == {
        tracker.name: tracker.conditions["manoeuvre: straight"].metrics["position_rmse"].value
        for tracker in result.summary.trackers
    }
    compared = tb.compare(result, metrics=["position_rmse", "velocity_rmse"])
    table = compared.to_pandas()
    assert len(table) == len(compared.differences) == 2
    assert table["verdict"].tolist() == [item.verdict for item in compared.differences]
    assert table["difference"].tolist() == [item.difference for item in compared.differences]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: tb.load("higway"), "higway: there is no such file; did you mean 'highway'?"),
        (lambda r: tb.load("highway", {"name": object()}), "name: cannot be written as YAML: an instance of object; "),
        (lambda r: tb.load("highway", trackers=[]), "name at least one tracker"),
        (lambda r: tb.load("name: x\n"), "scenario.yaml:1: truth: missing; where the true motion comes from"),
        (lambda r: tb.sense("highway", range(99, 101)), "runs: there is no run 100; choose from 0 to 99"),
        (lambda r: tb.run("highway", workers=0), "workers: 0 is not a number of processes; give a whole number from 1"),
        (lambda r: tb.run("highway", out="/proc/x"), "cannot write to /proc/x"),
        (lambda r: r["ekf"], "no tracker 'ekf' in this result; did you mean 'ekf_cv'?"),
        (lambda r: r.to_pandas("step"), "no table 'step' in this result; did you mean 'steps'?"),
        (lambda r: r.figure("error"), "no figure 'error' in this report; did you mean 'errors'?"),
        (lambda r: r.figure("errors").save("x.bmp"), "x.bmp ends in none of .svg, .pdf"),
        (lambda r: tb.compare(r, metrics=["position_rsme"]), "did you mean 'position_rmse'?"),
        (lambda r: tb.load(None), "None is no scenario; give a file, a name such as 'highway', a text or a mapping"),
        (lambda r: tb.compare(None), "None cannot be compared; give a result, a list of results, or a folder"),
        (lambda r: tb.compare(r, r, "ekf_cv"), "choose trackers by compare(..., trackers=['ekf_cv'])"),
        (lambda r: tb.compare(["a", "b"]), "give each folder as an argument of its own: compare('a', 'b')"),
        (lambda r: tb.load("highway", trackers={"mine": dict}), "load(..., {'trackers.mine': {'use': Mine}})"),
        (lambda r: tb.compare(r, r, limits="position_rmse:5"), "limits are a mapping, such as {'position_rmse': 5}"),
        (lambda r: tb.load("highway", {"trackers.mine": dict}), "use: {'trackers.mine': {'use': dict}}"),
        (lambda r: tb.load("highway", {"truth": {"duration_s": 5}}), "one key of it write {'truth.duration_s': 5}"),
    ],
)
def test_what_is_wrong_is_one_clear_exception(
    call: Callable[[tb.Result], object],
    message: str,
    result: tb.Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(tb.InputError) as caught:
        call(result)
    assert message in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_what_has_another_place_or_name_is_told(result: tb.Result) -> None:
    with pytest.raises(TypeError, match=r"runs belongs to the scenario: run\(load\(..., runs=2\)\)"):
        tb.run("highway", runs=2)  # type: ignore[arg-type]
    with pytest.raises(AttributeError, match="did you mean 'velocity_rmse' or 'position_rmse'"):
        _ = result["ekf_cv"].rmse


def test_a_result_is_pickled_after_its_report_was_read(result: tb.Result) -> None:
    figures = result.figures
    again = pickle.loads(pickle.dumps(result))
    assert again["ekf_cv"] == result["ekf_cv"]
    assert again.figures == figures
