"""What a tracker assumes of a sensor's noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.scenes import scan

from trackbench.base.errors import InputErrors, TrackbenchError
from trackbench.models.sensors import Lidar, Radar
from trackbench.scenario import load_scenario
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

KEYS = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "initial": "first_measurement"}


def tracker(**keys: Any) -> Any:
    config = FilterConfig.model_validate({**KEYS, **keys})
    return build_multi(config).tracker if config.associate else build(config).tracker


@pytest.mark.parametrize("more", [{}, {"filter": "kf"}, {"filter": "ukf"}])
def test_assumed_noise_is_as_if_the_sensor_stated_it(more: dict[str, Any]) -> None:
    noise = np.diag([0.3, np.deg2rad(0.5), 0.1]) ** 2
    other = np.diag([0.5, np.deg2rad(0.5), 0.2]) ** 2
    assuming = tracker(**more, measurement_noise={"radar": {"range_sigma_m": 0.5, "range_rate_sigma_mps": 0.2}})
    plain, a, b = tracker(**more), None, None
    for k in range(5):
        seen = scan("radar", 0.1 * k, np.array([[50.0 + k], [0.2], [1.0]]), noise=noise)
        a, found = assuming.step(a, seen)
        b, expected = plain.step(b, seen._replace(noise_covariance=other))
        np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-12)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-12)


def test_other_sensors_and_correlations_stay() -> None:
    correlated = np.array([[4.0, 1.0], [1.0, 9.0]])
    np.testing.assert_allclose(Lidar.other_noise(correlated, {"position_sigma_m": 1.0}), [[1, 1 / 6], [1 / 6, 1]])
    polar = Radar.other_noise(np.diag([1.0, 1.0, 1.0]), {"azimuth_sigma_deg": 180.0})
    np.testing.assert_allclose(np.sqrt(np.diag(polar)), [1.0, np.pi, 1.0])
    seen = scan("lidar", 0.0, np.array([[5.0], [2.0]]))
    assert tracker(measurement_noise={"radar": {"range_sigma_m": 9.0}}).assumed.read(seen) is seen


def test_one_of_several_objects_assumes_it_too() -> None:
    with_gnn = {"associate": {"method": "gnn", "confirm": [1, 1]}, "initial": {"from": "first_measurement"}}
    seen = scan("lidar", 0.0, np.array([[5.0], [2.0]]), noise=np.diag([0.04, 0.04]))
    _, tracks = tracker(**with_gnn, measurement_noise={"lidar": {"position_sigma_m": 2.0}}).step(None, seen)
    np.testing.assert_allclose(np.diag(tracks.covariance[..., 0])[:2], 4.0)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{rader: {range_sigma_m: 1}}", "the scenario has no sensor 'rader'; did you mean 'radar'"),
        ("{radar: {range_sigma: 1}}", "a radar has no such standard deviation; did you mean 'range_sigma_m'"),
        ("{lidar: {azimuth_sigma_deg: 1}}", "a lidar has no such standard deviation"),
        ("{radar: {range_sigma_m: 0}}", "it must be at least 1e-09"),
    ],
)
def test_what_does_not_fit_is_one_message(tiny: Path, entry: str, message: str) -> None:
    text = tiny.read_text().replace("ekf: {filter: ekf,", f"ekf: {{filter: ekf, measurement_noise: {entry},")
    tiny.write_text(text)
    with pytest.raises(TrackbenchError) as caught:
        load_scenario(tiny)
    assert not isinstance(caught.value, InputErrors)
    assert message in str(caught.value)
    assert "measurement_noise" in str(caught.value)
