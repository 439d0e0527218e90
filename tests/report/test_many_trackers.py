"""Above 30 trackers each is compared with the best, and with a baseline where the scenario names one."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.special import stdtr, stdtrit

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.document.markdown import to_markdown
from trackbench.metrics.differences import LEVEL, MOST_PAIRED, corrected_p_values
from trackbench.report.console import print_summary
from trackbench.report.pairs import standing
from trackbench.report.result import result_document
from trackbench.results import Result

SCENARIO = """\
name: many
truth: {source: scripted, duration_s: 2, rate_hz: 10, objects: {car: {start: {x: 20, speed_mps: 3}}}}
sensors:
  roof: {type: lidar, rate_hz: 10, position_sigma_m: 0.1}
trackers:
  raw: {use: raw}
  kf: {filter: kf, motion: cv, sweep: {acceleration_sigma_mps2: SIGMAS}}
monte_carlo: {runs: 12, seed: 7}
expect:
  - {tracker: kf_0p6, metric: velocity_rmse, better_than: raw}
  - {tracker: kf_0p6, metric: position_rmse, better_than: raw}
"""
SIGMAS = [round(0.2 + 0.2 * number, 1) for number in range(MOST_PAIRED)]


def run(folder: Path, text: str) -> Result:
    path = folder / "many.yaml"
    path.write_text(text.replace("SIGMAS", str(SIGMAS)), encoding="utf-8")
    return tb.run(path)


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(tmp_path_factory.mktemp("many"), SCENARIO)


def judged(result: Result) -> list[tuple[str, str, str]]:
    return [(item.metric, item.a, item.b) for item in result.differences if item.verdict is not None]


def test_each_is_compared_with_the_best_and_as_expected(many: Result) -> None:
    names = [tracker.name for tracker in many.contenders]
    best = names[0]
    assert many.summary.score.best == best
    of_best = {("position_rmse", best, name) for name in names[1:]}
    stated = {("velocity_rmse", "kf_0p6", "raw"), ("position_rmse", "kf_0p6", "raw")}
    assert of_best <= set(judged(many)) <= of_best | stated
    assert {item.tracker for item in many.summary.expectations if item.passed} == {"kf_0p6"}
    for item in many.differences:
        assert best in (item.a, item.b) or (item.metric, item.a, item.b) in stated


def test_the_column_says_who_is_not_shown_worse(many: Result, tmp_path: Path) -> None:
    column = standing(many)
    assert column.heading == "not shown worse than the best"
    shown = dict(zip((tracker.name for tracker in many.scored), column.cells, strict=True))
    best = many.contenders[0].name
    worse = {item.b for item in many.differences if (item.metric, item.a, item.better) == ("position_rmse", best, best)}
    assert "raw" in worse
    assert {name for name, cell in shown.items() if cell != "yes"} == worse
    page = to_markdown(result_document(many))
    assert "not shown worse than the best" in page
    assert "The best 12 of 31 trackers" in page
    assert f"called worse than {many.contenders[0].name}, which was chosen from the same data" in page
    assert f"minus {many.contenders[0].name}, m" in page
    console = Console(file=io.StringIO(), width=80)
    print_summary(many, console, wide=True)
    assert f"best?: not shown to be worse than {many.contenders[0].name}, the best of 31, by more than 5 mm" in (
        " ".join(console.file.getvalue().split())
    )
    many.save(tmp_path / "many")
    assert Result.load(tmp_path / "many").differences == many.differences


@pytest.mark.parametrize(("trackers", "runs"), [(31, 12), (60, 100), (200, 20)])
def test_a_difference_so_much_larger_is_just_shown(trackers: int, runs: int) -> None:
    """The quantile at the level over the number of pairs."""
    t = stdtrit(runs - 1, 1 - LEVEL / (trackers * (trackers - 1)))
    p_value = 2 * float(stdtr(runs - 1, np.array(-t)))
    others = [1.0] * (trackers - 2)
    choices = [(trackers - 1) / 2] * (trackers - 1)
    assert corrected_p_values([p_value, *others], choices)[0] == pytest.approx(LEVEL)


def test_with_a_baseline_each_is_compared_with_it(tmp_path: Path) -> None:
    result = run(tmp_path, SCENARIO + "score: {baseline: raw}\n")
    names = [tracker.name for tracker in result.contenders]
    assert (result.summary.score.baseline, result.summary.score.best) == ("raw", None)
    assert {b for metric, a, b in judged(result) if (metric, a) == ("position_rmse", "raw")} == {*names} - {"raw"}
    column = standing(result)
    assert column.heading == "against raw"
    assert set(column.cells) <= {"better", "worse", "equivalent", "undecided", "baseline"}
    assert column.cells[names.index("raw")] == "baseline"
    assert f"{names[0]} is best in this scene" in to_markdown(result_document(result))


def test_a_baseline_that_is_no_tracker_has_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"score.baseline: the scenario has no tracker 'rav'; did you mean 'raw'"):
        run(tmp_path, SCENARIO + "score: {baseline: rav}\n")
