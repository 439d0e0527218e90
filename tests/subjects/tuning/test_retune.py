"""The tuner of process noise that the cells of an envelope use."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.base.execution import executor
from trackbench.base.subjects import offered, resolve

#: A car that turns, and a filter whose process noise is far too small.
TURNING: dict[str, Any] = {
    "name": "turning",
    "truth": {
        "source": "scripted",
        "duration_s": 10,
        "rate_hz": 10,
        "objects": {
            "car": {
                "start": {"x": 20, "y": 5, "speed_mps": 10},
                "pieces": [{"for_s": 4}, {"for_s": 3, "turn_rate_degps": 20}, {"for_s": 3}],
            }
        },
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.5}},
    "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 0.5}},
    "monte_carlo": {"runs": 40, "seed": 1},
    "expect": [{"tracker": "kf", "metric": "position_rmse", "below": 0.3}],
}


def retuned(scenario: dict[str, Any]) -> tb.Scenario:
    """As an envelope asks for it."""
    tune = resolve(next(target for _, target in offered("tuners")))
    with executor(1) as chosen:
        result: tb.Scenario = tune(tb.load(scenario), chosen)
    return result


def test_it_comes_within_2_percent_of_the_best_of_a_sweep_of_the_scenario_s_own_runs() -> None:
    tuned = retuned(TURNING)
    # The tracker as it is, as it is tuned, and with each value of the sweep, in one run.
    (change,) = tuned.overrides
    key, _, value = change.rpartition("=")
    assert key == "trackers.kf.acceleration_sigma_mps2"
    sigmas = [0.5, float(value), *np.geomspace(2, 12, 15).tolist()]
    trackers = {
        f"kf_{i}": TURNING["trackers"]["kf"] | {"acceleration_sigma_mps2": sigma} for i, sigma in enumerate(sigmas)
    }
    result = tb.run(tb.load(TURNING | {"trackers": trackers, "expect": []}), workers=1)
    start, own, *sweep = (result[name].position_rmse.value for name in trackers)
    assert own < 1.02 * min(sweep)
    # Which the start is far from.
    assert start > 1.3 * min(sweep)


def test_it_is_the_same_every_time_and_loads_again_from_its_changes() -> None:
    first, second = retuned(TURNING), retuned(TURNING)
    assert first.overrides == second.overrides != ()
    assert tb.load(TURNING, first.overrides).config == first.config


def test_trackers_of_one_s_own_stay_as_they_are() -> None:
    assert retuned(TURNING | {"trackers": {"kf": {"use": "raw"}}}).overrides == ()


def test_a_point_of_a_sweep_is_refused() -> None:
    swept = {"kf": TURNING["trackers"]["kf"] | {"sweep": {"acceleration_sigma_mps2": [1, 2]}}}
    expect = [{"tracker": "kf_1", "metric": "position_rmse", "below": 0.3}]
    with pytest.raises(InputError, match="a point of a sweep"):
        retuned(TURNING | {"trackers": swept, "expect": expect})


def test_the_cells_of_a_map_are_judged_by_tuned_trackers() -> None:
    """A filter that fails everywhere as it is holds with a process noise that fits."""
    axes = {"sigma": {"key": "sensors.lidar.position_sigma_m", "values": [0.3, 0.5]}}
    limit = [{"tracker": "kf", "metric": "position_rmse", "below": 0.5}]
    block = {"axes": axes, "runs": {"first": 60, "most": 60}}
    for retune, states in ((False, ["fails", "fails"]), (True, ["holds", "holds"])):
        scenario = TURNING | {"expect": limit, "envelope": {**block, "retune": retune}}
        claim = tb.envelope(scenario, counter_examples=0).claim
        assert [cell.trackers["kf"].state for cell in claim.cells] == states
