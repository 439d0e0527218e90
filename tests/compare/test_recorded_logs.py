"""Versions of a tracker on recorded logs: over stretches of time, with a limit."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.support.udacity import synthetic_lines

import trackbench as tb
from trackbench.compare.assembly import compare_results
from trackbench.compare.entries import Entry
from trackbench.compare.limits import Limit
from trackbench.results import Result

SCENARIO = """
name: NAME
truth: {source: recording, format: udacity, path: PATH}
sensors:
  lidar: {type: lidar, position_sigma_m: 0.15}
  radar: {type: radar, range_sigma_m: 0.3, azimuth_sigma_deg: 1.718873, range_rate_sigma_mps: 0.3}
trackers:
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: Q}
  raw: {use: raw}
monte_carlo: {runs: 1}
"""
Run = Callable[..., list[Result]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The results of the scenarios of logs of so many lines, 50 ms apart; once for each."""

    @cache
    def result(name: str, q: float, lines: int, seed: int) -> Result:
        folder = tmp_path_factory.mktemp("log")
        (folder / f"{name}.txt").write_text("\n".join(synthetic_lines(lines, seed)))
        text = SCENARIO.replace("NAME", name).replace("PATH", f"{name}.txt").replace("Q", str(q))
        (folder / f"{name}.yaml").write_text(text)
        return tb.run(folder / f"{name}.yaml", workers=1)

    def run(q: float = 3, lines: int = 400, logs: tuple[str, ...] = ("log",), seed: int = 1) -> list[Result]:
        return [result(name, q, lines, seed + number) for number, name in enumerate(logs)]

    return run


def outcomes(
    sets: list[list[Result]], percent: float = 10, metric: str = "velocity_rmse"
) -> dict[tuple[str, str], str]:
    comparison = compare_results(sets, limits=[Limit(metric, percent)])
    return {(item.scenario, item.entrant.tracker): item.outcome for item in comparison.gates}


def test_a_worse_tracker_fails_the_limit_and_an_equal_one_keeps_it(run: Run) -> None:
    before, same, worse = run(), run(), run(q=60)
    assert outcomes([before, worse]) == {("log", "ekf"): "failed", ("log", "raw"): "passed"}
    assert outcomes([before, same]) == {("log", "ekf"): "passed", ("log", "raw"): "passed"}
    comparison = compare_results([before, worse], metrics=["velocity_rmse"], trackers=["ekf"])
    (item,) = comparison.differences
    assert (item.verdict, item.paired_runs, item.stretches) == ("worse", 1, 4)
    assert comparison.notes == ["Judged among 1 of the 2 trackers: with all 2 the corrected p-values may be larger."]


def test_each_log_of_a_folder_is_compared(run: Run) -> None:
    logs = ("log", "tuesday")
    before, worse = run(logs=logs), run(q=60, logs=logs)
    found = outcomes([before, worse])
    assert {name: found[name, "ekf"] for name in logs} == dict.fromkeys(logs, "failed")
    assert outcomes([before, before]) == {(name, tracker): "passed" for name in logs for tracker in ("ekf", "raw")}


def test_a_recorded_log_without_an_interval_is_judged_by_its_values(run: Run) -> None:
    """A log of 6 s."""
    lines, metric = 120, "velocity_rmse"
    before, worse, other = run(lines=lines), run(q=60, lines=lines), run(lines=lines, seed=9)
    comparison = compare_results([before, worse], metrics=[metric], trackers=["ekf"])
    (item,) = comparison.differences
    assert item.ci95 is None
    assert item.percent is not None
    name = ("log", "ekf")
    assert outcomes([before, worse], item.percent - 0.1, metric)[name] == "failed"
    assert outcomes([before, worse], item.percent + 0.1, metric)[name] == "passed"
    assert outcomes([worse, before], 0, metric)[name] == "passed"
    # Another log of the same motion has noise of its own, and one value of each shows nothing.
    assert outcomes([before, other], 1e6, metric)[name] == "undecided"


def test_the_interval_is_that_of_the_run(run: Run) -> None:
    """What a comparison reads of the stretches is what the run has made its own interval of."""
    entry = Entry("log", run()[0])
    for path in ("position_rmse", "velocity_rmse", "position_over_reference", "velocity_over_reference"):
        metric = next(item for item in tb.metrics.BUILT_IN if item.path == path)
        interval = entry.interval("ekf", metric, over_stretches=True)
        assert interval is not None
        assert interval.ci95 == pytest.approx(entry.result["ekf"].metrics[path].ci95, rel=1e-9)


def test_few_logs_of_one_scenario_are_compared_over_the_stretches_of_all(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    for number, lines in enumerate((400, 250)):
        (tmp_path / "logs" / f"{number}.txt").write_text("\n".join(synthetic_lines(lines, number)))
    results = []
    for q in (3, 60):
        file = tmp_path / "both.yaml"
        file.write_text(
            SCENARIO.replace("NAME", "both").replace("PATH", "[logs/0.txt, logs/1.txt]").replace("Q", str(q))
        )
        results.append(tb.run(file, workers=1))
    found = outcomes([[result] for result in results])
    assert found == {("both", "ekf"): "failed", ("both", "raw"): "passed"}
    comparison = compare_results([[result] for result in results], trackers=["ekf"])
    (item,) = comparison.differences
    assert (item.paired_runs, item.stretches, item.scenes) == (2, 4 + 3, 2)
    table = results[0].tables.stretches.to_pandas().query("tracker == 'ekf'")
    assert table["run"].tolist() == [0] * 4 + [1] * 3
    runs = results[0].tables.runs.to_pandas().query("tracker == 'ekf'")
    assert table.groupby("run")["count"].sum().tolist() == runs["count"].tolist()
    # Of each log by itself the stretches are the same.
    one_log = {"truth.path": "logs/1.txt", "trackers.ekf.acceleration_sigma_mps2": 3}
    alone = tb.run(tb.load(tmp_path / "both.yaml", one_log), workers=1)
    ours = alone.tables.stretches.to_pandas().query("tracker == 'ekf'")
    np.testing.assert_allclose(table["velocity_rmse_mps"][-3:], ours["velocity_rmse_mps"], rtol=1e-12)
