"""As many runs as a precision takes: the same result as so many runs, and honest about it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.base.execution import executor
from trackbench.results import Result
from trackbench.runner import work
from trackbench.runner.run import FIRST_RUNS, first_look, run_scenario, run_until
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.truth import truths_of

Cli = Callable[..., Any]

RANDOM = """truth={source: scripted, duration_s: 2, rate_hz: 10, objects: {
    a: {start: {x: 30}, pieces: [{white: {motion: cv, acceleration_sigma_mps2: 1}}]},
    b: {start: {x: 50}}}}"""


def until(tiny: Path, target: float, max_runs: int, *overrides: str, workers: int = 1) -> Result:
    first = first_look(load_scenario(tiny, overrides), max_runs)
    with executor(workers) as chosen:
        return run_until(first, truths_of(first), target, max_runs, executor=chosen, command=command)


def command(loaded: Scenario) -> str:
    return " ".join(loaded.overrides)


def comparable(result: Result) -> dict[str, Any]:
    """The result but for times and for how its number of runs was chosen."""
    summary = json.loads(json.dumps(result.json()))
    for tracker in summary["trackers"]:
        tracker["metrics"].pop("step_time")
    summary["truth"].pop("cached")
    summary.pop("precision", None)
    return {**summary, "command": "", "provenance": None}


@pytest.mark.parametrize("batch", [2000, 90])
@pytest.mark.parametrize("overrides", [(), (RANDOM,)], ids=["one motion", "random motion"])
def test_the_result_is_that_of_as_many_runs_bit_for_bit(
    tiny: Path, monkeypatch: pytest.MonkeyPatch, batch: int, overrides: tuple[str, ...]
) -> None:
    """In one block that grows, and in several of which the last one is cut short."""
    monkeypatch.setattr(work, "BATCH_SIZE", batch)
    found = until(tiny, 0.012, 2000, *overrides)
    runs = found.json()["runs"]
    assert found.json()["precision"]["reached"]
    assert runs > 2 * FIRST_RUNS
    loaded = load_scenario(tiny, (*overrides, f"monte_carlo.runs={runs}"))
    # Which limits BLAS to one thread, as ``until`` does: with more, sums are made in another order.
    with executor(1) as chosen:
        same = run_scenario(loaded, truths_of(loaded), executor=chosen)
    assert comparable(found) == comparable(same)
    for name, table in same.tables.items():
        assert found.tables[name].equals(table) or name == "steps", name
        for column in table.column_names:
            np.testing.assert_array_equal(np.asarray(found.tables[name][column]), np.asarray(table[column]))


def test_it_stops_as_soon_as_the_interval_is_that_narrow(tiny: Path) -> None:
    result = until(tiny, 0.02, 2000)
    found = result.json()
    (difference,) = (item for item in result.differences if item.metric == "position_rmse")
    best = next(item for item in found["trackers"] if item["name"] == found["ranking"][0])
    low, high = difference.ci95
    precision = found["precision"]
    assert precision["half_width"] == pytest.approx((high - low) / 2 / best["metrics"]["position_rmse"]["value"])
    assert precision["half_width"] <= 0.02
    assert (precision["best"], precision["second"]) == tuple(found["ranking"][:2])
    fewer = until(tiny, 0.02, FIRST_RUNS).json()["precision"]
    assert not fewer["reached"]
    assert fewer["half_width"] > 0.02
    assert found["command"] == f"monte_carlo.runs={found['runs']}"


def test_it_ends_at_the_stated_number(tiny: Path) -> None:
    found = until(tiny, 1e-6, 70).json()
    assert found["runs"] == 70
    assert found["precision"]["reached"] is False
    assert found["precision"]["half_width"] > 1e-6


def test_any_number_of_workers_gives_the_same(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work, "BATCH_SIZE", 60)
    assert comparable(until(tiny, 0.02, 500, workers=2)) == comparable(until(tiny, 0.02, 500))


def test_without_two_scores_it_does_not_go_on(tiny: Path) -> None:
    found = until(tiny, 1e-6, 10_000, "trackers.ekf={use: 'math:pi'}").json()
    assert found["runs"] == FIRST_RUNS
    assert found["precision"]["half_width"] is None
    assert found["precision"]["reached"] is False


def test_the_recorded_run_is_among_the_first(tiny: Path) -> None:
    assert until(tiny, 1.0, 500, "monte_carlo.runs=100", "recording.run=80").json()["runs"] == 81


@pytest.mark.slow
def test_the_command_line_says_what_was_reached(cli: Cli, tiny: Path) -> None:
    done = cli("run", "tiny.yaml", "--no-recording", "--runs-until", "0.02", "--seed", "3")
    assert (done.status, done.err) == (0, "")
    assert max(map(len, done.out.splitlines())) <= 80
    summary = json.loads((tiny.parent / "results" / "tiny" / "result.json").read_text(encoding="utf-8"))
    runs = summary["runs"]
    assert f"after {runs} runs; 2.00\N{NO-BREAK SPACE}% wanted" in done.out
    assert summary["command"] == f"trackbench run tiny.yaml --set monte_carlo.seed=3 --set monte_carlo.runs={runs}"
    done = cli(*summary["command"].split()[1:], "--no-recording", "--json")
    assert done.status == 0
    again = Result.from_json(json.loads(done.out), {})
    assert comparable(again) == comparable(Result.from_json(summary, {}))
    done = cli("run", "tiny.yaml", "--no-recording", "--runs-until", "0.0001", "--max-runs", "60")
    assert "wanted, not reached" in " ".join(done.out.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--runs-until", "0.01", "--runs", "5"], "--runs-until: give no --runs beside it"),
        (["--runs-until", "nan"], "'--runs-until': 'nan' is not a share such as 0.01 or 1%"),
        (["--runs-until", "1"], "'--runs-until': 1 is a share of 100 %; for 1 % write 1%"),
        (["--runs-until", "50%"], "'--runs-until': 50% is not a share above 0 and below 0.5"),
        (["--runs-until", "1 %", "--trackers", "ekf"], "tiny.yaml: --runs-until: needs two trackers"),
        (["--max-runs", "5"], "--max-runs: is where --runs-until stops"),
        (["--runs-until", "0.01", "--trackers", "ekf"], "tiny.yaml: --runs-until: needs two trackers"),
        (
            ["--runs-until", "0.01", "--max-runs", "3", "--set", "recording.run=3"],
            "recording.run: must be from 0 to 2",
        ),
        (["--runs-until", "0.01", "--max-runs", "999999", "--set", RANDOM], "tiny.yaml: --max-runs: random motion is"),
    ],
)
def test_bad_input(cli: Cli, tiny: Path, arguments: list[str], message: str) -> None:
    done = cli("run", "tiny.yaml", *arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.err
    assert not (tiny.parent / "results" / "tiny").exists()
