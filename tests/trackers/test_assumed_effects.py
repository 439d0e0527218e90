"""What a tracker assumes of a sensor's effects: closed forms, a filter of ten lines, consistency where it is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import integrate
from tests.support.scenes import fixed_observer, scan, tracker, truth

from trackbench.base.errors import InputErrors, TrackbenchError
from trackbench.engine.choice import Engine
from trackbench.models.motion import Kinematics
from trackbench.models.sensors import Radar
from trackbench.models.sensors.detection import FALSE_ALARM_PROBABILITY, signal_ratio
from trackbench.models.sensors.effects.signal import SignalRange
from trackbench.results import Result
from trackbench.scenario import load_scenario
from trackbench.sensing.scans import ideal_sensors, measured

SIGNAL = {"half_range_m": 140, "stated_at_m": 60, "constant_share": 0.5}
RADAR = {"rate_hz": 10, "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1}
CV = {"motion": "cv", "acceleration_sigma_mps2": 1.0}


def simulated(sensor: Any, start: tuple[float, ...], steps: int, runs: int, acceleration: float = 1.0) -> Any:
    """Truth ``(4, steps, runs)`` driven by the noise of a CV model at 10 Hz, and its scans; the sensor stands at 0."""
    random, dt = np.random.default_rng(3), 0.1
    push = acceleration * random.standard_normal((steps, 2, runs))
    x = np.empty((steps, 4, runs))
    x[0] = np.array(start)[:, None]
    for k in range(1, steps):
        position, velocity = x[k - 1, :2], x[k - 1, 2:]
        x[k] = np.concatenate([position + dt * velocity + dt**2 / 2 * push[k], velocity + dt * push[k]])
    time = np.arange(steps) * dt
    # Each run is an object of its own, but a bias is drawn once a run.
    scans = []
    for run in range(runs):
        of = truth(time, *(x[:, i, run, None, None] for i in range(4)), observer=fixed_observer(steps))
        scans.append(measured(ideal_sensors(of, {"sensor": sensor})[0], 1, "assumed", run)[:2])
    kind = sensor.kind()
    values = np.stack([value[:, :, 0] for value, _ in scans], axis=-1)
    there = np.stack([valid[:, 0] for _, valid in scans], axis=-1)
    noise = sensor.noise_covariance()
    return x, [scan(kind, t, values[:, k], there[k], noise) for k, t in enumerate(time)]


def estimates(x: Any, scans: list[Any], engine: Engine = "numpy", **keys: Any) -> list[Any]:
    """Of a tracker that starts from a state drawn around the truth."""
    initial = {"from": "truth", "position_sigma_m": 1.0, "velocity_sigma_mps": 1.0}
    own = replace(tracker(**{**CV, **keys, "initial": initial}), engine=engine)
    runs, speed = x.shape[-1], np.hypot(*x[0, 2:])
    motion = Kinematics(*x[0, :2], speed, np.arctan2(x[0, 3], x[0, 2]), 0 * speed, 0 * speed)
    own = own.with_prior(np.zeros(runs), motion, np.random.default_rng(5).standard_normal((12, runs)))
    state, result = None, []
    for seen in scans:
        state, estimate = own.step(state, seen)
        result.append(estimate)
    return result


def within(values: Any, expected: float, errors: float = 4.0) -> bool:
    """Whether the mean of independent values is so many standard errors from what is expected, or fewer."""
    return bool(abs(values.mean() - expected) < errors * values.std(ddof=1) / np.sqrt(len(values)))


@pytest.mark.parametrize("distance", [10.0, 60.0, 140.0, 300.0])
def test_the_mean_variance_is_the_integral_over_the_powers_that_are_detected(distance: float) -> None:
    signal = SignalRange(**SIGNAL)
    mean, threshold = 1 + signal_ratio(np.array(distance), 140), -np.log(FALSE_ALARM_PROBABILITY)
    inverse, _ = integrate.quad(lambda p: np.exp(-(p - threshold) / mean) / mean / p, threshold, threshold + 60 * mean)
    expected = 0.5 + 0.5 * (1 + signal_ratio(np.array(60.0), 140)) * inverse
    np.testing.assert_allclose(signal.mean_variance_factor(np.array(distance)), expected, rtol=1e-7)


def by_range(**keys: Any) -> dict[int, Any]:
    """``(runs,)`` mean NIS of a radar's measurements of each run in bands of 30 m."""
    sensor = Radar(**RADAR, effects=[{"type": "signal_to_noise", **SIGNAL}])
    x, scans = simulated(sensor, (10.0, 5.0, 8.0, 0.5), steps=150, runs=300)
    nis = np.stack([np.sum(e.whitened_innovation**2, axis=0) for e in estimates(x, scans, filter="ekf", **keys)])
    distance = np.hypot(x[:, 0], x[:, 1])
    valid = np.stack([seen.valid for seen in scans])
    bands = {}
    for low in (10, 40, 70, 100):
        inside = valid & (distance >= low) & (distance < low + 30)
        some = inside.sum(axis=0) > 5
        bands[low] = np.where(inside, nis, 0.0).sum(axis=0)[some] / inside.sum(axis=0)[some]
    return bands


def test_the_nis_is_right_at_all_ranges_where_the_noise_by_range_is_assumed() -> None:
    assuming, stated = by_range(assume={"radar": {"signal_to_noise": SIGNAL}}), by_range()
    assert all(within(values, 3.0) for values in assuming.values())
    assert stated[10].mean() < 2.4
    assert stated[100].mean() > 9.0


@pytest.mark.parametrize("filter", ["kf", "ekf", "iekf", "ukf", "ckf"])
def test_the_fused_engine_computes_the_same(filter: str) -> None:
    x, scans = simulated(Radar(**RADAR), (20.0, 5.0, 8.0, 0.5), steps=20, runs=30)
    keys = {"filter": filter, "assume": {"radar": {"signal_to_noise": SIGNAL}}}
    pairs = zip(*(estimates(x, scans, engine=engine, **keys) for engine in ("numpy", "fused")), strict=True)
    for numpy, fused in pairs:
        np.testing.assert_allclose(fused.mean, numpy.mean, rtol=1e-10)
        np.testing.assert_allclose(fused.covariance, numpy.covariance, rtol=1e-9, atol=1e-12)


def test_the_description_of_a_tracker_names_what_it_assumes(run_tiny: Callable[..., Result]) -> None:
    result = run_tiny("trackers.ekf.assume.radar.signal_to_noise={half_range_m: 140, stated_at_m: 60}")
    assert "radar with signal to noise assumed" in result["ekf"].describe


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{rader: {signal_to_noise: {half_range_m: 140, stated_at_m: 60}}}", "the scenario has no sensor 'rader'"),
        ("{radar: {}}", "says nothing; add signal_to_noise"),
        ("{radar: {signal_to_nois: {half_range_m: 140}}}", "did you mean 'signal_to_noise'"),
        (
            "{radar: {signal_to_noise: {half_range_m: 50, stated_at_m: 60}}}",
            "must be at most half_range_m, which is 50",
        ),
    ],
)
def test_what_does_not_fit_is_one_message(tiny: Path, entry: str, message: str) -> None:
    tiny.write_text(tiny.read_text().replace("ekf: {filter: ekf,", f"ekf: {{filter: ekf, assume: {entry},"))
    with pytest.raises(TrackbenchError) as caught:
        load_scenario(tiny)
    assert not isinstance(caught.value, InputErrors)
    assert message in str(caught.value)
    assert "assume" in str(caught.value)
