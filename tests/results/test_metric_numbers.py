"""A metric value is a number that prints itself, and a tracker's metrics are known to an editor."""

from __future__ import annotations

import ast
import inspect

import pytest

from trackbench.base.errors import InputError
from trackbench.metrics import BUILT_IN
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.results import Health, MetricValue, TrackerResult
from trackbench.results import tracker_result as module


@pytest.mark.parametrize(
    ("value", "ci95", "unit", "printed"),
    [
        (0.0971, (0.0901, 0.1179), "m", "0.0971 m (0.090 to 0.118)"),
        (2.917, (2.878, 2.957), "1", "2.9170 (2.878 to 2.957)"),
        (812.4, (750.0, 880.0), "m", "812.4 m (750 to 880)"),
        (0.0547512, None, "us", "0.05475 us"),
        (1.0, (1.0, 1.0), "1", "1"),
    ],
)
def test_it_prints_its_unit_and_interval(
    value: float, ci95: tuple[float, float] | None, unit: str, printed: str
) -> None:
    metric = MetricValue(value=value, ci95=ci95, unit=unit)
    assert str(metric) == f"{metric}" == printed
    assert f"{metric:.1f}" == f"{value:.1f}"


def test_it_is_compared_and_sorted_as_a_number() -> None:
    small, large = MetricValue(value=0.1, unit="m"), MetricValue(value=0.2, unit="m")
    assert small < large
    assert large >= small > 0.05
    assert not small <= 0.05
    assert sorted([large, small]) == [small, large]
    assert float(max(small, large)) == 0.2


def test_without_a_value_the_reason_is_said() -> None:
    none = MetricValue(unit="m", reason="the tracker failed")
    assert str(none) == "no value: the tracker failed"
    with pytest.raises(InputError, match="there is no value: the tracker failed"):
        _ = none < 1


def test_a_tracker_lists_its_metrics_and_says_the_nearest_name() -> None:
    metric = MetricValue(value=0.1, unit="m")
    tracker = TrackerResult(name="kf", describe="", failed=None, health=Health(), metrics={"position_rmse": metric})
    assert tracker.position_rmse is tracker.metrics["position_rmse"]
    assert "position_rmse" in dir(tracker)
    assert "model_dump" not in dir(tracker)
    with pytest.raises(AttributeError, match="did you mean 'position_rmse'"):
        _ = tracker.position_rms  # type: ignore[attr-defined]


def test_an_editor_knows_the_built_in_metrics() -> None:
    classes = {item.name: item for item in ast.parse(inspect.getsource(module)).body if isinstance(item, ast.ClassDef)}
    block = next(item for item in classes["TrackerResult"].body if isinstance(item, ast.If))
    targets = [item.target for item in block.body if isinstance(item, ast.AnnAssign)]
    declared = {target.id for target in targets if isinstance(target, ast.Name)}
    of_estimates = {metric.name for metric in BUILT_IN if metric.name.isidentifier() and not metric.per_sensor}
    assert of_estimates <= declared <= of_estimates | TRACK_METRICS.keys()
