"""A tracker that is shown to beat a true Cramér-Rao bound is said first; below another reference it is a remark."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from trackbench.report.console import print_summary
from trackbench.report.sentences import answer_of_run, below_the_bound
from trackbench.results import MetricValue, Result

BEATS = "beats the Cramér-Rao bound: it knows more than its measurements say"


def below(result: Result, kind: str, acceleration: float, upper: float = 0.9) -> Result:
    """The result with an EKF whose error over the reference has this upper limit."""
    ratio = MetricValue(value=0.8, ci95=(0.7, upper), unit="1")
    ekf = result["ekf"]
    ekf = ekf.model_copy(update={"metrics": {**ekf.metrics, "position_over_reference": ratio}})
    reference = result.summary.held_against.model_copy(update={"kind": kind, "acceleration_sigma_mps2": acceleration})
    return result.updated(trackers=[ekf, result["raw"]], reference=reference)


def test_one_that_beats_a_true_bound_is_said_first_and_is_not_ranked(tiny_result: Result) -> None:
    result = below(tiny_result, "bound", 2.0)
    assert result.why_unscored(result["ekf"]) == f"it {BEATS}"
    assert [tracker.name for tracker in result.scored] == ["raw"]
    assert answer_of_run(result).startswith(f"ekf {BEATS}; raw has ")
    assert not below_the_bound(result)
    error = result["ekf"].position_rmse.value
    assert error is not None
    text = printed(result)
    assert text.startswith(f"{result.name}: ekf {BEATS}; ")
    assert f"NOT RANKED ekf: it {BEATS}; position RMSE {error:.4f} m"[:90] in text


@pytest.mark.parametrize(("kind", "acceleration"), [("bound", 0.0), ("reference", 2.0)])
def test_below_any_other_reference_it_is_a_remark(tiny_result: Result, kind: str, acceleration: float) -> None:
    result = below(tiny_result, kind, acceleration)
    label = result.summary.held_against.label
    remark = f"ekf is below the {label}: it expects this motion, or uses more than its measurements"
    assert below_the_bound(result) == [remark]
    assert remark in printed(result)
    assert not result.why_unscored(result["ekf"])


def test_one_that_is_not_shown_to_is_ranked(tiny_result: Result) -> None:
    result = below(tiny_result, "bound", 2.0, upper=0.98)
    assert not result.why_unscored(result["ekf"])
    assert not below_the_bound(result)


def printed(result: Result) -> str:
    console = Console(width=250, record=True, file=io.StringIO())
    print_summary(result, console)
    return console.export_text()
