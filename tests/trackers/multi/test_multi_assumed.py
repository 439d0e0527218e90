"""What trackers of several objects assume of a sensor's effects: noise and detection by range, errors as states."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.support.traffic_scans import traffic, vehicles
from tests.trackers.multi.test_multi_tracker import followed
from tests.trackers.test_assumed_effects import BIASED, CV, KNOWN, RADAR, SIGNAL, simulated
from tests.trackers.test_assumed_effects import followed as followed_labelled

from trackbench.base.types import FieldOfView, Scan
from trackbench.models.sensors import Radar
from trackbench.models.sensors.detection import FALSE_ALARM_PROBABILITY, signal_ratio
from trackbench.models.sensors.effects.signal import SignalRange
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.late import LateScans
from trackbench.trackers.multi import MultiObjectTracker, build_multi
from trackbench.trackers.multi.intensity import Undetected, volumes


def tracker(method: str, engine: str = "numpy", **keys: Any) -> MultiObjectTracker:
    given = {"filter": "ekf", **CV, "associate": {"method": method}, **keys}
    return replace(build_multi(FilterConfig.model_validate(given)).tracker, engine=engine)


def clustered(seed: int = 3) -> Any:
    """Scans in which tracks share detections."""
    return traffic(vehicles(6, spacing=9.0), 12, runs=3, detection=0.85, clutter=8.0, seed=seed)


@pytest.mark.parametrize("effects", [{"signal_to_noise": SIGNAL}, {"signal_to_noise": SIGNAL, **BIASED}, KNOWN])
@pytest.mark.parametrize("method", ["gnn", "jpda", "pmb"])
def test_the_fused_engine_computes_the_same(method: str, effects: dict[str, Any]) -> None:
    of, seen = tracker(method, assume={"radar": effects}), clustered()
    fused = replace(of, engine="fused")
    for found, expected in zip(followed(fused, seen), followed(of, seen), strict=True):
        np.testing.assert_array_equal(found.ids, expected.ids)
        np.testing.assert_array_equal(found.used, expected.used)
        np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-7, atol=1e-8)
    assert not fused.engine_used.why_numpy


def hidden(scan: Scan) -> Scan:
    """The scan of a single object in each run, as one of detections that nobody labelled."""
    return scan._replace(
        measurement=scan.measurement[:, None], valid=scan.valid[None], detection_probability=0.9,
        clutter_density=1e-6, field_of_view=FieldOfView(np.pi, 300.0),
    )  # fmt: skip


EFFECTS = [
    ([{"type": "signal_to_noise", **SIGNAL}], {"signal_to_noise": SIGNAL}),
    (
        [{"type": "correlated_errors", "share": 0.8, "time_s": 1.0}, {"type": "bias", "sigmas": {"azimuth_deg": 0.5}}],
        KNOWN,
    ),
]


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize(("effects", "assumed"), EFFECTS)
def test_a_track_without_doubt_is_that_of_the_labelled_object(effects: Any, assumed: Any, late: bool) -> None:
    _, scans = simulated(Radar(**RADAR, effects=effects), (20.0, 5.0, 20.0, 1.0), steps=25, runs=40)
    assert scans[0].valid.all()
    if late:
        scans[-2:] = [scans[-1], scans[-2]._replace(arrival_time=scans[-1].time)]
    keys = {"filter": "ekf", "assume": {"radar": assumed}}
    expected = followed_labelled(scans, **keys)[-1]
    associate = {"method": "gnn", "confirm": [1, 1], "gate": 1 - 1e-9}
    of, state = LateScans(tracker("gnn", assume={"radar": assumed}, associate=associate)), None
    taken = np.ones(40, dtype=bool)
    for seen in scans:
        state, found = of.step(state, hidden(seen))
        taken &= (found.used[0] >= 0) == seen.valid
    # The power that fluctuates gives errors longer tails than a Gaussian's, so that some are outside the gate. A weak
    # signal stays weak, which adds to these.
    assert taken.mean() > 0.8
    np.testing.assert_allclose(found.mean[:, 0, taken], expected.mean[:, taken], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.covariance[:, :, 0, taken], expected.covariance[..., taken], rtol=1e-8, atol=1e-10)


def seen_at(distance: float, time: float, detected: bool) -> Scan:
    """A radar's scan of one run, with one detection or none."""
    measurement = np.array([[distance], [0.1], [0.0]])[:, : int(detected)]
    return Scan(
        time, "radar", "radar", measurement, np.ones(int(detected), dtype=bool), Radar(**RADAR).noise_covariance(),
        np.zeros(3), np.zeros(2), time, 0.9, 1e-4, FieldOfView(np.pi, 250.0),
    )  # fmt: skip


def detected(distance: Any) -> Any:
    return FALSE_ALARM_PROBABILITY ** (1 / (1 + signal_ratio(np.asarray(distance), 140)))


@pytest.mark.parametrize("method", ["jipda", "pmb"])
@pytest.mark.parametrize("distance", [30.0, 140.0, 200.0])
def test_existence_reckons_with_the_detection_probability_of_the_range(method: str, distance: float) -> None:
    associate = {"method": method, "birth_rate_hz": 1e-9, "lifetime_s": 1e9, "visible_s": None, "gate": 1 - 1e-12}
    of = tracker(method, associate=associate, assume={"radar": {"signal_to_noise": SIGNAL}})
    state, _ = of.step(None, seen_at(distance, 0.0, True))
    probability = 0.9 * detected(distance)
    new = 10.0 / volumes("radar", FieldOfView(np.pi, 250.0), 20.0)[0] * probability
    exists = new / (new + 1e-4)
    assert state.table.evidence[0, 0] == pytest.approx(exists, rel=1e-9)
    after, _ = of.step(state, seen_at(distance, 1e-9, False))
    # The bias of the range is taken out of a track.
    probability = 0.9 * detected(np.hypot(*state.table.belief.mean[:2, 0]))
    expected = exists * (1 - probability) / (1 - exists * probability)
    assert after.table.evidence[0, 0] == pytest.approx(expected, rel=1e-6)


def test_a_scan_finds_the_share_of_its_view_that_the_signal_lets_it_detect() -> None:
    start, signal = Undetected(10.0, {}), SignalRange(**SIGNAL)
    left = start.after_scan(seen_at(50.0, 0.0, False), 0.9, signal.half_range_m).in_view("radar")
    radii = 250.0 * np.sqrt((np.arange(4000) + 0.5) / 4000)
    # Eight points of the radius against four thousand.
    assert left == pytest.approx(10.0 * (1 - 0.9 * detected(radii).mean()), rel=0.01)
