"""What a sensor that a tracker does not read changes: nothing in its estimates at the instants that it had before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from tests.scenes import NOISE, TRACKERS, random_walk, scan, tracker, work

from trackbench.models.sensors import Lidar, Radar
from trackbench.runner.block import RecordedEstimates, run_block
from trackbench.trackers.config import FilterConfig, PluginConfig

LIDAR = Lidar(rate_hz=10, phase_s=0.05, position_sigma_m=0.3, detection_probability=0.8)
RADAR = Radar(rate_hz=20, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.2)
#: The radar is the first of the two in the order of the sensors, and the last.
ORDERS = {"radar_first": {"radar": RADAR, "lidar": LIDAR}, "radar_last": {"lidar": LIDAR, "radar": RADAR}}
RUNS, DT = 3, 0.05
TRUTH = random_walk(RUNS, 81, DT, 2.0, 5, np.array([60.0, 20.0, 10.0, -5.0]))
#: Of the truth's steps, those at which the lidar measures.
OWN = slice(1, None, 2)


def estimates(sensors: Mapping[str, Radar | Lidar], config: FilterConfig | PluginConfig) -> RecordedEstimates:
    """Of one tracker, at every instant at which a sensor measures."""
    block = run_block(work(TRUTH, sensors, {"one": config}, RUNS), range(RUNS))
    return block.recorded["one"]


def assert_same(a: RecordedEstimates, b: RecordedEstimates) -> None:
    """To the last bit."""
    assert np.isfinite(a.mean[:, 2:]).any()
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.covariance, b.covariance)


def at_own(found: RecordedEstimates) -> RecordedEstimates:
    return RecordedEstimates(found.mean[:, OWN], found.covariance[:, :, OWN])


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
@pytest.mark.parametrize("start", ["two_readings", "first_reading", "truth"])
@pytest.mark.parametrize("keys", TRACKERS.values(), ids=TRACKERS)
def test_estimates_do_not_depend_on_a_sensor_that_is_not_read(
    keys: dict[str, Any], start: str, order: Mapping[str, Radar | Lidar]
) -> None:
    config = FilterConfig.model_validate({**keys, "initial": start, "sensors": ["lidar"]})
    assert_same(at_own(estimates(order, config)), estimates({"lidar": LIDAR}, config))


@pytest.mark.parametrize("options", [{}, {"sensors": ["radar", "lidar"]}], ids=["reads_all", "reads_both"])
def test_a_built_in_filter_by_name_is_told_what_it_does_not_read(options: dict[str, Any]) -> None:
    of = PluginConfig(use="ekf", options={"motion": "cv", **NOISE["cv"], **options}, sensors=["lidar"])
    assert_same(at_own(estimates(ORDERS["radar_first"], of)), estimates({"lidar": LIDAR}, of))


def test_the_baseline_does_not_depend_on_it_either() -> None:
    of = PluginConfig(use="raw", sensors=["lidar"])
    assert_same(at_own(estimates(ORDERS["radar_first"], of)), estimates({"lidar": LIDAR}, of))


def test_between_its_own_scans_it_predicts_from_the_last_of_them() -> None:
    made = tracker(filter="kf", motion="cv", acceleration_sigma_mps2=2, initial="first_reading", sensors=["lidar"])
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
    keys = {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 2, "initial": "first_reading"}
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
    initial = {"from": "two_readings", "sensors": ["radar"]}
    made = tracker(filter="kf", motion="cv", **NOISE["cv"], sensors=["lidar"], initial=initial)
    assert made.advances("radar")
    assert made.advances("lidar")
    assert not made.advances("camera")
