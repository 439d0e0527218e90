"""Latency: in which order trackers get scans, and when they are asked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.conftest import Outcome
from tests.support.scenes import scan

import trackbench as tb
from trackbench.base.types import Scan
from trackbench.driving.drive import deliveries
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import Measurements, arrivals, ideal_sensors, sense_known


def seen(sensor: str, time: float, latency: float = 0.0) -> Scan:
    return scan("lidar", time, np.zeros((2, 1)))._replace(sensor=sensor, arrival_time=time + latency)


def given(scans: list[Scan], *unread: str) -> list[list[tuple[str, float, bool]]]:
    found = deliveries(scans, {one.sensor for one in scans} - {*unread})
    return [[(one.scan.sensor, one.scan.time, one.scan.asked) for one in group] for group in found]


def test_without_latency_each_scan_is_given_at_its_instant() -> None:
    scans = [seen("a", 0), seen("b", 0), seen("a", 0.1), seen("b", 0.2)]
    assert given(scans) == [[("a", 0, False), ("b", 0, False)], [("a", 0.1, False)], [("b", 0.2, False)]]
    groups = list(deliveries(scans, ["a"]))
    assert [one.scan.valid.any() for group in groups for one in group] == [True, False, True, False]


def test_scans_are_given_as_they_arrive_and_estimates_are_asked_for() -> None:
    scans = [seen("late", 0, 0.15), seen("prompt", 0), seen("late", 0.1, 0.15), seen("late", 0.2, 0.05)]
    scans += [seen("prompt", 0.3)]
    assert given(scans) == [
        [("prompt", 0, False)],
        [("late", 0.1, True)],
        [("late", 0, False), ("late", 0.2, True)],
        # What was taken later arrives first, if its latency is so much shorter.
        [("late", 0.1, False), ("late", 0.2, False), ("prompt", 0.3, False)],
    ]
    # Of a sensor that is not read a tracker hears nothing but that it is asked.
    assert given(scans, "late") == [
        [("prompt", 0, False)],
        [("late", 0.1, True)],
        [("late", 0.2, True)],
        [("prompt", 0.3, False)],
    ]
    asked = list(deliveries(scans))[1][0].scan
    assert (asked.time, asked.arrival_time, asked.valid.any(), np.isnan(asked.measurement).all()) == (0.1, 0.1, 0, 1)


def test_a_drawn_latency_is_the_same_in_every_run_and_between_its_ends(tiny: Path) -> None:
    loaded = load_scenario(tiny, ["sensors.radar.latency_s=[0.05, 0.2]"])
    (truth,) = truths_of(loaded)
    radar, lidar = ideal_sensors(truth.truth, loaded.config.sensors)
    late = arrivals(radar, 7, "tiny") - radar.time
    assert 0.05 <= late.min() < 0.08 < 0.17 < late.max() <= 0.2
    np.testing.assert_array_equal(arrivals(lidar, 7, "tiny"), lidar.time)
    assert not np.array_equal(arrivals(radar, 8, "tiny") - radar.time, late)
    few, many = (tb.run(tb.load(tiny, {"sensors.radar.latency_s": [0.05, 0.2]}, runs=runs)) for runs in (2, 5))
    assert few.summary.fingerprints == many.summary.fingerprints[:2]
    one, other = (result.to_pandas("runs").query("tracker == 'ekf' and run < 2") for result in (few, many))
    np.testing.assert_allclose(one["position_rmse_m"], other["position_rmse_m"], rtol=1e-12)


@pytest.mark.parametrize("sensed", [sense_known, sense_hidden])
def test_scans_say_their_place_among_those_of_one_time(
    sensed: Callable[..., Measurements | Measurements], tiny: Path
) -> None:
    loaded = load_scenario(tiny)
    (truth,) = truths_of(loaded)
    scans = sensed(ideal_sensors(truth.truth, loaded.config.sensors), 7, "tiny", range(2)).scans
    assert [(one.time, one.place) for one in scans] == sorted((one.time, one.place) for one in scans)
    names = list(loaded.config.sensors)
    assert all(one.sensor == names[one.place] for one in scans)
    assert len({one.time for one in scans}) < len(scans)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("[0.2, 0.1]", "the least comes first: [0.1, 0.2]"),
        ("soon", "a number in seconds is needed"),
        ("{}", "write a time, such as 0.1, or the least and the most, such as [0.05, 0.2]"),
        ("-1", "must be at least 0"),
        ("[0.1]", "2"),
    ],
)
def test_a_wrong_latency_is_said(value: str, message: str, tiny: Path, cli: Callable[..., Outcome]) -> None:
    tiny.write_text(tiny.read_text().replace("azimuth_sigma_deg: 0.5", f"azimuth_sigma_deg: 0.5, latency_s: {value}"))
    found = cli("check", tiny.name)
    assert found.status == 2
    assert "tiny.yaml:12: sensors.radar.latency_s" in found.err
    assert message in found.err
