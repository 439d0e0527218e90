"""Whether the order of trackers holds with other drivers: many scenes of ``highway``."""

from __future__ import annotations

from typing import Any

import yaml
from benchmarks.tuned.protocol import SCENARIOS
from benchmarks.tuned.protocol import read as read_protocol

import trackbench as tb

TRACKERS = ("ekf_cv", "imm_cv_ca", "imm_three")
#: So that the velocity has verdicts too.
JUDGED = [{"tracker": TRACKERS[0], "metric": "velocity_rmse", "better_than": name} for name in TRACKERS[1:]]
DRIVERS = ("steady", "human")
SCENES, RUNS = 36, 2
#: Scenes and runs that trackers are tuned on, with other seeds, and sets of values that are tried.
TUNED_FROM, TUNED_SCENES, TUNED_RUNS, TRIALS = 101, 12, 1, 60


def measured() -> dict[str, Any]:
    """By drivers: the errors of each tracker, and the differences between them; last with the trackers tuned again."""
    worlds = {drivers: _scores(_scenario(drivers)) for drivers in DRIVERS}
    values = _tuned("human")
    worlds["human, tuned again"] = {**_scores(_scenario("human"), values), "values": values}
    return worlds


def _scenario(drivers: str, first: int = 1, scenes: int = SCENES) -> dict[str, Any]:
    content = yaml.safe_load((SCENARIOS / "highway.yaml").read_text(encoding="utf-8"))
    content["truth"] |= {"drivers": drivers, "seed": first, "seeds": scenes}
    trackers = {name: content["trackers"][name] for name in TRACKERS}
    return {**content, "trackers": trackers, "expect": []}


def _tuned(drivers: str) -> dict[str, Any]:
    """The values of each tracker, by the ranges of the protocol of ``make tuned`` and fewer trials."""
    protocol = read_protocol()
    return {
        name: tb.tune(
            _scenario(drivers, TUNED_FROM, TUNED_SCENES),
            [name],
            ranges=protocol.trackers[name]["ranges"],
            objective=protocol.objective,
            trials=TRIALS,
            train_scenes=TUNED_SCENES,
            train_runs=TUNED_RUNS,
            test_scenes=1,
            test_runs=1,
        ).values[name]
        for name in TRACKERS
    }


def _scores(scenario: dict[str, Any], values: dict[str, Any] | None = None) -> dict[str, Any]:
    changes = {f"trackers.{name}.{key}": value for name, of in (values or {}).items() for key, value in of.items()}
    result = tb.run(tb.load({**scenario, "expect": JUDGED}, changes, runs=RUNS))
    errors = {
        name: {metric: getattr(result[name], metric).value for metric in ("position_rmse", "velocity_rmse", "nees")}
        for name in TRACKERS
    }
    differences = [
        {
            **{key: getattr(pair, key) for key in ("metric", "a", "b", "value", "margin", "verdict")},
            "ci95": list(pair.ci95),
        }
        for pair in result.differences
        if pair.metric in ("position_rmse", "velocity_rmse") and pair.a == "ekf_cv"
    ]
    return {"errors": errors, "differences": differences}
