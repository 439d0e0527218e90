"""A metric of one's own: in the result, in expectations and tables, and alone if it raises."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trackbench.base.errors import InputError
from trackbench.compare.comparability import stored_metric
from trackbench.results import Result
from trackbench.scenario import load_scenario

Run = Callable[..., Result]
Write = Callable[[Path, str], str]

CODE = """
import numpy as np
from trackbench.metrics import EstimateMetric, Field, Metric, ratio

class Square(Metric):
    '''The mean square error of the position: that of position_rmse, squared.'''
    name, unit, meaning, better = "square", "m^2", "mean square error of the position", "smaller"
    def init(self, scope):
        return np.zeros((2, scope.runs))
    def update(self, sums, chunk):
        return sums + [chunk.by_run(1.0), chunk.by_run(chunk.error[0] ** 2 + chunk.error[1] ** 2)]
    def merge(self, blocks):
        return np.concatenate(blocks, axis=1)
    def finish(self, sums):
        return ratio(sums[1], sums[0], at_least=0.0)

class Within(Square):
    '''Share of the estimates that are near the truth.'''
    name, unit, meaning, better = "within", "1", "share of the estimates that are near the truth", "larger"
    limit_m: float = 0.5
    def update(self, sums, chunk):
        near = np.hypot(chunk.error[0], chunk.error[1]) < self.limit_m
        return sums + [chunk.by_run(1.0), chunk.by_run(near)]

class Largest(Metric):
    '''The largest innovation of each sensor, in standard deviations: a value that is no mean.'''
    name, unit, meaning, per_sensor = "largest", "1", "largest innovation", True
    def init(self, scope):
        return dict.fromkeys(scope.measurements, 0.0)
    def update(self, sums, chunk):
        for sensor, innovations in chunk.innovations.items():
            for one in innovations:
                if one.whitened is not None and one.used.any():
                    sums[sensor] = max(sums[sensor], np.linalg.norm(one.whitened[:, one.used], axis=0).max())
        return sums
    def merge(self, blocks):
        return {sensor: max(block[sensor] for block in blocks) for sensor in blocks[0]}
    def finish(self, sums):
        return {sensor: value or None for sensor, value in sums.items()}

class Lost(EstimateMetric):
    '''From the sums of the built-in metrics.'''
    name, unit, meaning = "estimates", "1", "number of estimates"
    def finish(self, sums):
        return sums.per_part[0].sum()
"""


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory, write_module: Write) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("metrics")
    return write_module(folder, CODE), folder


@pytest.fixture(scope="module")
def found(run_tiny: Run, module: tuple[str, Path]) -> Result:
    name, folder = module
    metrics = f"['{name}:Square', {{use: '{name}:Within', options: {{limit_m: 0.3}}}}, '{name}:Largest', '{name}:Lost']"
    expect = (
        "[{tracker: ekf, metric: square, below: 1}, {tracker: ekf, metric: within, above: 0.5}, "
        "{tracker: ekf, metric: within, better_than: raw}, {tracker: raw, metric: square, better_than: ekf}, "
        "{tracker: ekf, metric: largest.radar, below: 100}]"
    )
    return run_tiny(
        f"score.metrics={metrics}", f"expect={expect}", "monte_carlo.runs=8", "score.settle_s=0.5", folder=folder
    )


def of_ekf(result: Result) -> Any:
    runs = result.tables.runs
    return runs.filter([name == "ekf" for name in runs["tracker"].to_pylist()])


def test_it_stands_in_the_result(found: Result, tmp_path: Path) -> None:
    ekf = found["ekf"]
    assert ekf.square.value == pytest.approx(ekf.position_rmse.value**2, rel=1e-12)
    assert ekf.square.unit == "m^2"
    assert ekf.square.ci95 is not None
    assert ekf.square.ci95 == pytest.approx([end**2 for end in ekf.position_rmse.ci95])
    assert ekf.metrics["largest.radar"].value > 1
    assert ekf.metrics["largest.radar"].ci95 is None
    assert found["raw"].metrics["largest.lidar"].value is None
    assert ekf.estimates.value == of_ekf(found)["count"].to_numpy().sum()
    assert [(item.name, item.better) for item in found.summary.score.metrics][:2] == [
        ("square", "smaller"),
        ("within", "larger"),
    ]
    found.save(tmp_path / "run")
    assert Result.load(tmp_path / "run").json() == found.json()


def test_expectations_name_it_and_its_direction_decides_who_is_better(found: Result) -> None:
    assert [item.passed for item in found.summary.expectations] == [True, True, True, False, True]
    winners = {item.metric: item.better for item in found.differences}
    assert winners["square"] == winners["within"] == "ekf"
    within = next(item for item in found.differences if item.metric == "within")
    assert (within.a, within.b, within.verdict) == ("raw", "ekf", "ekf better")
    assert within.value < 0
    assert "largest.radar" not in winners


def test_the_table_of_runs_gives_it_back(found: Result) -> None:
    square = stored_metric(found.summary.score.metrics[0])
    interval = square.of_runs(*(of_ekf(found)[name].to_numpy() for name in square.columns))
    assert interval is not None
    assert interval.value == pytest.approx(found["ekf"].square.value, rel=1e-12)
    assert interval._replace(at_least=0.0).ci95 == pytest.approx(found["ekf"].square.ci95, rel=1e-9)


@pytest.mark.parametrize("method", ["init", "update", "merge"])
def test_one_whose_sums_raise_ends_the_run(run_tiny: Run, tmp_path: Path, write_module: Write, method: str) -> None:
    broken = CODE + f"\nclass Broken(Square):\n    def {method}(self, *_):\n        raise RuntimeError('no luck')\n"
    with pytest.raises(RuntimeError, match="no luck"):
        run_tiny(f"score.metrics=['{write_module(tmp_path, broken)}:Broken']", folder=tmp_path, workers=1)


def test_one_whose_finish_raises_has_no_value_and_says_why(
    run_tiny: Run, tmp_path: Path, write_module: Write, caplog: pytest.LogCaptureFixture
) -> None:
    broken = CODE + "\nclass Broken(Square):\n    def finish(self, *_):\n        raise RuntimeError('no\\nluck')\n"
    result = run_tiny(f"score.metrics=['{write_module(tmp_path, broken)}:Broken']", folder=tmp_path)
    assert caplog.messages == ["metric square has no value: RuntimeError: no luck"]
    for tracker in result.summary.trackers:
        assert (tracker.square.value, tracker.square.reason) == (None, "RuntimeError: no luck")
        assert tracker.position_rmse.value is not None
    assert {item.metric for item in result.differences}.isdisjoint({"square"})


#: What ``finish`` gives, and why the metric then has no value.
NO_VALUES = {
    "float('nan')": "it is not a number",
    "None": "it is not a number",
    "'high'": "must be real number, not str",
    "Interval(1.0, np.full(4, np.nan))": "the influence of an interval must be finite",
    "Interval(1.0, np.zeros(3))": "interval must be an array of numbers of shape (4,), not one of shape (3,)",
    "Interval(1.0, [0.0] * 4)": "interval must be an array of numbers of shape (4,), not [0.0, 0.0, 0.0, 0.0]",
    "MetricValue.model_construct(value=float('nan'), unit='m^2')": "finite number",
    "MetricValue(value=float('nan'), unit='m^2')": "finite number",
    "{'value': 1.0, 'mean': 2.0}": "that finish returns must be odd_8, not ['odd_8.value', 'odd_8.mean']",
    "{'radar': 1.0}": "must be odd_9, not ['odd_9.radar']",
    "{'': 1.0, 5: 2.0}": "must be odd_10, not ['odd_10', 'odd_10.5']",
    "[1.0]": "must be real number, not list",
    "{}": "must be odd_12, not []",
}


def test_what_cannot_stand_in_a_result_breaks_the_metric_alone(
    run_tiny: Run, tmp_path: Path, write_module: Write
) -> None:
    code = f"{CODE}from trackbench.metrics import Interval; from trackbench.results import MetricValue\n"
    for number, value in enumerate(NO_VALUES):
        code += f"class Odd{number}(Square):\n    name = 'odd_{number}'\n    def finish(self, sums): return {value}\n"
    name = write_module(tmp_path, code)
    metrics = [f"{name}:Odd{number}" for number in range(len(NO_VALUES))]
    ekf = run_tiny(f"score.metrics={[*metrics, f'{name}:Within']}", folder=tmp_path)["ekf"]
    for number, reason in enumerate(NO_VALUES.values()):
        assert ekf.metrics[f"odd_{number}"].value is None
        assert reason in ekf.metrics[f"odd_{number}"].reason
    assert ekf.position_rmse.value is not None
    assert ekf.within.value is not None


@pytest.mark.parametrize("key", ["mean", "value", "sonar"])
def test_a_value_by_sensor_is_that_of_one_of_the_sensors(
    run_tiny: Run, tmp_path: Path, write_module: Write, key: str
) -> None:
    odd = f"\nclass Odd(Largest):\n    def finish(self, sums):\n        return {{'{key}': 1.0}}\n"
    result = run_tiny(f"score.metrics=['{write_module(tmp_path, CODE + odd)}:Odd']", folder=tmp_path)
    reason = f"must be largest.lidar and largest.radar, not ['largest.{key}']"
    assert reason in result["ekf"].metrics["largest"].reason


NO_NAME = "class Nameless(Metric):\n    unit, meaning = '1', 'none'\n    def init(self, scope): pass\n"


@pytest.mark.parametrize(
    ("metrics", "key", "message"),
    [
        ("['math:pi']", "score.metrics.0", "'math:pi' is no metric: it must be a subclass of trackbench.metrics"),
        ("['{0}:Nameless']", "score.metrics.0", "'{0}:Nameless' is no metric: it lacks name and finish"),
        ("['{0}:Taken']", "score.metrics.0", "'{0}:Taken' is no metric: its name 'nees' is that of a built-in one"),
        ("['{0}:Square', '{0}:Square']", "score.metrics.1", "a second metric of the name square"),
        ("[{{use: '{0}:Within', option: {{}}}}]", "score.metrics.0.option", "unknown key; did you mean 'options'?"),
        ("[{{options: {{}}}}]", "score.metrics.0.use", "missing; choose from: module:Class"),
        ("[{{use: '{0}:Within', options: {{limit_m: far}}}}]", "score.metrics.0.options.limit_m", "a number in metres"),
    ],
)  # fmt: skip
def test_bad_input(tiny: Path, write_module: Write, metrics: str, key: str, message: str) -> None:
    code = CODE + NO_NAME + "class Taken(Square):\n    name = 'nees'\n"
    name = write_module(tiny.parent, code)
    with pytest.raises(InputError) as caught:
        load_scenario(tiny, [f"score.metrics={metrics.format(name)}"])
    assert caught.value.key == key
    assert message.format(name) in caught.value.message


@pytest.mark.parametrize(
    ("base", "body", "message"),
    [
        ("Square", "name = 5", "is no metric: its name must be text, not 5"),
        ("Square", "unit = None", "is no metric: its unit must be text, not None"),
        ("Square", "better = []", 'is no metric: better must be "smaller", "larger" or None, not []'),
        ("Square, metaclass=Odd", "pass", "is no metric: RuntimeError: no luck"),
        ("Square", "def problems(self): raise RuntimeError('no luck')", "these options: RuntimeError: no luck"),
    ],
)
def test_a_class_that_is_wrong_is_one_message(
    tiny: Path, write_module: Write, base: str, body: str, message: str
) -> None:
    meta = """
class Odd(type(Metric)):
    def __getattribute__(cls, name):
        if name == "meaning":
            raise RuntimeError("no luck")
        return super().__getattribute__(name)
"""
    name = write_module(tiny.parent, f"{CODE}{meta}\nclass Wrong({base}):\n    {body}\n")
    with pytest.raises(InputError) as caught:
        load_scenario(tiny, [f"score.metrics=['{name}:Wrong']"])
    assert message in caught.value.message
    assert caught.value.key == "score.metrics.0"
