"""Comparisons of runs of hidden identities."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import trackbench as tb
from trackbench.compare import compare
from trackbench.document.files import text
from trackbench.errors import InputError
from trackbench.report.comparison import document
from trackbench.results import Result


def test_trackers_are_compared_by_gospa(traffic_result: Result) -> None:
    found = compare([traffic_result])
    assert found.ranked_by == "gospa"
    for item in found.differences:
        assert item.metric == "gospa"
        ours = traffic_result[item.entrant.tracker].metrics["gospa"].value
        theirs = traffic_result[item.against.tracker].metrics["gospa"].value
        assert ours is not None
        assert theirs is not None
        assert item.difference == pytest.approx(ours - theirs)
    (stored,) = (
        d for d in traffic_result.summary.differences if (d.metric, d.a, d.b) == ("gospa", *_pair(traffic_result))
    )
    (item,) = (d for d in found.differences if (d.entrant.tracker, d.against.tracker) == _pair(traffic_result))
    assert item.ci95 == pytest.approx(stored.ci95)


def _pair(result: Result) -> tuple[str, str]:
    return result.summary.ranking[0], result.summary.ranking[-1]


@pytest.mark.parametrize("metric", ["hota", "position_rmse", "nees", "id_switches"])
def test_every_metric_of_the_run_is_compared(traffic_result: Result, metric: str) -> None:
    for item in compare([traffic_result], metrics=[metric]).differences:
        ours = traffic_result[item.entrant.tracker].metrics[metric].value
        assert item.value == pytest.approx(ours)


def test_a_result_is_the_same_as_itself(cli: Callable[..., Any], traffic_folder: Path) -> None:
    done = cli("compare", traffic_folder, traffic_folder, "--fail-on-regression", "gospa:1")
    assert done.status == 0
    assert "4 of 4 limits kept" in done.out


def test_over_scenarios_trackers_are_ranked_by_gospa(traffic_result: Result) -> None:
    other = traffic_result.updated(scenario=traffic_result.summary.scenario.model_copy(update={"name": "again"}))
    page = text(document(compare([[traffic_result, other]]), times=True))
    assert "Rank by GOSPA within each scenario" in page
    assert "Missed part of GOSPA, m" in page
    assert "consistent" not in page


def test_known_and_hidden_identities_are_not_compared(traffic_result: Result, tiny_result: Result) -> None:
    message = "cannot be compared with results 1: identities are hidden here and known there"
    with pytest.raises(InputError, match=message):
        compare([tiny_result, traffic_result])
    with pytest.raises(InputError, match="identities are known here and hidden there"):
        compare([[traffic_result, tiny_result]])


def test_another_cutoff_is_another_score(traffic_text: str, traffic_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "three_cars.yaml").write_text(traffic_text + "score: {cutoff_m: 3}\n", encoding="utf-8")
    other = tb.run(tmp_path / "three_cars.yaml")
    with pytest.raises(InputError, match=r"another scenario: score\.cutoff_m is 3.* here and 5.* there"):
        compare([Result.load(traffic_folder), other])


def test_a_batch_of_both_is_run_and_not_compared(
    cli: Callable[..., Any], tiny: Path, traffic_text: str, tmp_path: Path
) -> None:
    (tmp_path / "three_cars.yaml").write_text(traffic_text, encoding="utf-8")
    done = cli("run", tiny, "three_cars.yaml", "--runs", "2")
    assert done.status == 0
    assert sorted(path.name for path in (tmp_path / "results").iterdir()) == ["three_cars", "tiny"]
    assert "Comparison of" not in done.out
