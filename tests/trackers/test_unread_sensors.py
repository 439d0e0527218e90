"""What a sensor that a tracker does not read changes: nothing in its estimates at the instants that it had before."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.support.scenes import NOISE, TRACKERS, scan, tracker

from trackbench.runner.loop import run_block
from trackbench.runner.recorded import RecordedEstimates
from trackbench.runner.work import work_of
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.scenario.truth import truths_of

LIDAR = {"type": "lidar", "rate_hz": 10, "phase_s": 0.05, "position_sigma_m": 0.3, "detection_probability": 0.8}
RADAR = {"type": "radar", "rate_hz": 20, "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.2}
#: The radar comes first at an instant, and last.
ORDERS = {"radar_first": {"radar": RADAR, "lidar": LIDAR}, "radar_last": {"lidar": LIDAR, "radar": RADAR}}
#: Of the truth's steps, those at which the lidar measures.
OWN = slice(1, None, 2)


def scenario(sensors: Mapping[str, Any], trackers: Mapping[str, Any], duration_s: float = 2, runs: int = 3) -> Scenario:
    """A car whose acceleration is white and constant from one truth step to the next."""
    start = {"x": 60, "y": 20, "vx_mps": 10, "vy_mps": -5}
    white = {"white_acceleration": {"x_sigma_mps2": 2, "y_sigma_mps2": 2}}
    values = {
        "name": "unread",
        "truth": {
            "source": "scripted",
            "duration_s": duration_s,
            "rate_hz": 20,
            "objects": {"car": {"start": start, "pieces": [white]}},
        },
        "sensors": sensors,
        "trackers": trackers,
        "monte_carlo": {"runs": runs},
        "score": {"settle_s": duration_s / 10},
    }
    return scenario_of(yaml.safe_dump(values, sort_keys=False), Path("unread.yaml"))


def estimates(sensors: Mapping[str, Any], trackers: Mapping[str, Any]) -> dict[str, RecordedEstimates]:
    """By tracker, at every instant at which a sensor measures."""
    loaded = scenario(sensors, trackers)
    work = work_of(loaded, truths_of(loaded))
    return run_block(work, work.pieces()[0]).recorded


def assert_lidar_alone_decides(trackers: Mapping[str, Any]) -> None:
    """Hold the estimates at the lidar's instants, to the last bit, against those without the radar."""
    alone = estimates({"lidar": LIDAR}, trackers)
    assert set(alone) == set(trackers)
    for order, sensors in ORDERS.items():
        both = estimates(sensors, trackers)
        assert set(both) == set(trackers)
        for name, without in alone.items():
            assert np.isfinite(without.mean[:, 5:]).all(), name
            np.testing.assert_array_equal(both[name].mean[:, OWN], without.mean, err_msg=f"{name}, {order}")
            np.testing.assert_array_equal(both[name].covariance[:, :, OWN], without.covariance, err_msg=name)


@pytest.mark.parametrize("start", ["two_measurements", "first_measurement", "truth"])
def test_estimates_do_not_depend_on_a_sensor_that_is_not_read(start: str) -> None:
    every = {
        name.replace("-", "_"): {**keys, "initial": start, "sensors": ["lidar"]} for name, keys in TRACKERS.items()
    }
    assert_lidar_alone_decides(every)


def test_between_its_own_scans_it_predicts_from_the_last_of_them() -> None:
    made = tracker(filter="kf", motion="cv", acceleration_sigma_mps2=2, initial="first_measurement", sensors=["lidar"])
    state, first = made.step(None, scan("lidar", 0.0, np.array([[40.0], [30.0]])))
    radar = np.array([[50.0], [0.6], [3.0]])
    for time in (0.1, 0.3):
        state, asked = made.step(state, scan("radar", time, radar))
        f, g = np.eye(4) + time * np.eye(4, k=2), np.kron([[time**2 / 2], [time]], np.eye(2))
        expected = f @ first.covariance[..., 0] @ f.T + 4.0 * g @ g.T
        np.testing.assert_allclose(asked.covariance[..., 0], expected, rtol=1e-12)
        assert asked.innovation is None
        assert state.time == 0.0


def test_all_scans_adds_the_process_noise_in_smaller_pieces() -> None:
    keys = {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 2, "initial": "first_measurement"}
    variances = {}
    for advance_at in ("own_scans", "all_scans"):
        made = tracker(**keys, sensors=["lidar"], advance_at=advance_at)
        state, first = made.step(None, scan("lidar", 0.0, np.array([[40.0], [30.0]])))
        for time in (0.1, 0.2):
            state, last = made.step(state, scan("radar", time, np.array([[50.0], [0.6], [3.0]])))
        variances[advance_at] = last.covariance[2, 2, 0] - first.covariance[2, 2, 0]
    # sigma^2 T^2, over the whole interval and over each half of it.
    assert variances == pytest.approx({"own_scans": 4 * 0.2**2, "all_scans": 2 * 4 * 0.1**2})


def test_a_sensor_that_only_starts_tracks_advances_the_state() -> None:
    initial = {"from": "two_measurements", "sensors": ["radar"]}
    made = tracker(filter="kf", motion="cv", **NOISE["cv"], sensors=["lidar"], initial=initial)
    assert made.advances("radar")
    assert made.advances("lidar")
    assert not made.advances("camera")
