"""Trials in one batch give what each gives by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from trackbench.api.scenario import load
from trackbench.base.execution import InProcess
from trackbench.scenario.truth import truths_of
from trackbench.subjects.tuning.evaluation import Bench, Evaluator
from trackbench.subjects.tuning.parameters import Parameter

SENSORS = {
    "lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15, "detection_probability": 0.8},
    "radar": {
        "type": "radar",
        "rate_hz": 10,
        "phase_s": 0.05,
        "range_sigma_m": 0.3,
        "azimuth_sigma_deg": 0.5,
        "range_rate_sigma_mps": 0.3,
    },
}
CTRV = {"acceleration_sigma_mps2": 1.0, "yaw_acceleration_sigma_radps2": 0.3}
TRACKERS = {
    "kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 1.0},
    "ekf": {"filter": "ekf", "motion": "ca", "jerk_sigma_mps3": 1.0},
    "ukf": {"filter": "ukf", "motion": "ctrv", **CTRV},
    "plain_ukf": {"filter": "ukf", "motion": "cv", "acceleration_sigma_mps2": 1.0, "augmented": False},
    "linear_ukf": {"filter": "ukf", "motion": "cv", "acceleration_sigma_mps2": 1.0},
    "ckf": {"filter": "ckf", "motion": "ctrv", **CTRV},
    "from_truth": {"filter": "ekf", "motion": "ctrv", **CTRV, "initial": "truth"},
    "imm": {
        "filter": "ekf",
        "motion": {
            "imm": [{"model": "cv", "acceleration_sigma_mps2": 0.5}, {"model": "ctrv", **CTRV}],
            "stay_s": [5, 5],
        },
    },
}
NOISES = {
    "kf": ["acceleration_sigma_mps2", "measurement_noise.radar.azimuth_sigma_deg"],
    "ekf": ["jerk_sigma_mps3", "measurement_noise.radar.range_rate_sigma_mps"],
    "ukf": [*CTRV, "measurement_noise.lidar.position_sigma_m"],
    "plain_ukf": ["acceleration_sigma_mps2"],
    "linear_ukf": ["acceleration_sigma_mps2"],
    "ckf": [*CTRV],
    "from_truth": [*CTRV],
    "imm": [
        "motion.imm.0.acceleration_sigma_mps2",
        "motion.imm.1.yaw_acceleration_sigma_radps2",
        "motion.stay_s.0",
    ],
}


def evaluator(tracker: str, keys: Sequence[str]) -> Evaluator:
    scenario = load(
        {
            "name": "batched",
            "truth": {
                "source": "scripted",
                "duration_s": 4,
                "rate_hz": 20,
                "objects": {
                    "a": {"start": {"x": 60, "y": 0, "vx_mps": 8, "vy_mps": 1}, "pieces": [{"turn_rate_degps": 10}]},
                    "b": {"start": {"x": -20, "y": 60, "vx_mps": 12}},
                },
            },
            "sensors": SENSORS,
            "trackers": {tracker: {"initial": "two_measurements", **TRACKERS[tracker]}},
            "monte_carlo": {"runs": 3, "seed": 4},
        }
    )
    parameters = [Parameter(key, "log", 0.01, 10.0) for key in keys]
    return Evaluator([Bench(scenario, truths_of(scenario))], tracker, parameters, InProcess())


@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_batch_of_trials_gives_what_each_gives_by_itself(tracker: str) -> None:
    random = np.random.default_rng(3)
    evaluate = evaluator(tracker, NOISES[tracker])
    points = [{key: float(random.uniform(0.1, 3.0)) for key in NOISES[tracker]} for _ in range(4)]
    together, apart = evaluate(points), [evaluate([point])[0] for point in points]
    assert not [outcome.failed for outcomes in (*together, *apart) for outcome in outcomes if outcome.failed]
    apart = [outcomes[0].sums for outcomes in apart]
    together = [outcomes[0].sums for outcomes in together]
    assert len({one.value("position_rmse") for one in apart if one is not None}) == len(points)
    for one, other in zip(together, apart, strict=True):
        assert one is not None
        assert other is not None
        for name, values in one.values.items():
            np.testing.assert_allclose(values, other.values[name], rtol=1e-12, err_msg=name)
