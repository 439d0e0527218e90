"""What a tracker assumes of a sensor's effects: closed forms, a filter of ten lines, consistency where it is right."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats
from tests.support.late_scans import late_tracker
from tests.support.scenes import fixed_observer, scan, tracker, truth

from trackbench.base.errors import InputErrors, TrackbenchError
from trackbench.filters.kalman import observe
from trackbench.models.motion import Kinematics
from trackbench.models.sensors import Lidar, Radar
from trackbench.models.sensors.detection import FALSE_ALARM_PROBABILITY, signal_ratio
from trackbench.models.sensors.effects.signal import SignalRange
from trackbench.scenario import load_scenario
from trackbench.sensing.scans import ideal_sensors, sense_known
from trackbench.trackers.builtin import filter_of
from trackbench.trackers.config import FilterConfig

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
        one = ideal_sensors(of, {"sensor": sensor})
        scans.append(sense_known(one, 1, "assumed", range(run, run + 1)).scans)
    kind = sensor.kind()
    values = np.stack([[scan.measurement[:, 0] for scan in of_run] for of_run in scans], axis=-1)
    there = np.stack([[scan.valid[0] for scan in of_run] for of_run in scans], axis=-1)
    noise = sensor.noise_covariance()
    return x, [scan(kind, t, values[k], there[k], noise) for k, t in enumerate(time)]


def estimates(x: Any, scans: list[Any], **keys: Any) -> list[Any]:
    """Of a tracker that starts from a state drawn around the truth."""
    initial = {"from": "truth", "position_sigma_m": 1.0, "velocity_sigma_mps": 1.0}
    own = tracker(**{**CV, **keys, "initial": initial})
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


def assuming(tiny: Path, filter: str, entry: str) -> None:
    """Write what a tracker of the tiny scenario assumes into it."""
    text = re.sub("initial: {[^}]*}", "initial: first_measurement", tiny.read_text())
    tiny.write_text(text.replace("ekf: {filter: ekf,", f"ekf: {{filter: {filter}, assume: {entry},"))


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{rader: {signal_to_noise: {half_range_m: 140, stated_at_m: 60}}}", "the scenario has no sensor 'rader'"),
        ("{radar: {}}", "is empty; add signal_to_noise or correlated_errors or bias"),
        ("{radar: {bias: {sigmas: {azimut_deg: 1}}}}", "is no component of a radar with its unit; did you mean"),
        ("{lidar: {correlated_errors: {components: [x, x], share: 0.5, time_s: 1}}}", "x is named twice; remove one"),
        ("{radar: {signal_to_nois: {half_range_m: 140}}}", "did you mean 'signal_to_noise'"),
        (
            "{radar: {signal_to_noise: {half_range_m: 50, stated_at_m: 60}}}",
            "must be at most half_range_m, which is 50",
        ),
    ],
)
def test_what_does_not_fit_is_one_message(tiny: Path, entry: str, message: str) -> None:
    assuming(tiny, "ekf", entry)
    with pytest.raises(TrackbenchError) as caught:
        load_scenario(tiny)
    assert not isinstance(caught.value, InputErrors)
    assert message in str(caught.value)
    assert "assume" in str(caught.value)


LIDAR = {"rate_hz": 10, "position_sigma_m": 0.3}
SLOW = {"components": ["x", "y"], "share": 0.8, "time_s": 1.0}
SLOW_RADAR = {"components": ["range", "azimuth", "range_rate"], "share": 0.8, "time_s": 1.0}


def augmented_filter(measurements: Any, times: Any, sigma: float, share: float, time_s: float, q: float) -> Any:
    """One axis of a constant velocity model with a slow error: position, velocity, error in m."""
    h, r = np.array([1.0, 0.0, 1.0]), (1 - share) * sigma**2
    slow = share * sigma**2
    # The first measurement says the position, with an error of which the slow one is a part.
    x, p = np.array([measurements[0], 0.0, 0.0]), np.diag([sigma**2, 2.0**2, slow])
    p[0, 2] = p[2, 0] = -slow
    result = [(x, p)]
    for z, dt in zip(measurements[1:], np.diff(times), strict=True):
        a = np.exp(-dt / time_s)
        f, g = np.array([[1, dt, 0], [0, 1, 0], [0, 0, a]]), np.array([dt**2 / 2, dt, 0])
        x, p = f @ x, f @ p @ f.T + q**2 * np.outer(g, g) + np.diag([0, 0, (1 - a**2) * slow])
        k = p @ h / (h @ p @ h + r)
        x, p = x + k * (z - h @ x), (np.eye(3) - np.outer(k, h)) @ p
        result.append((x, p))
    return result


@pytest.mark.parametrize("filter", ["ekf", "ukf", "ckf"])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_a_lidar_with_slow_errors_is_the_augmented_filter_of_textbooks(filter: str, yaw: float) -> None:
    random, times = np.random.default_rng(2), np.cumsum(np.r_[0.0, np.random.default_rng(4).uniform(0.05, 0.3, 40)])
    z = np.stack([5 + 3 * times, 2 - times]) + 0.3 * random.standard_normal((2, len(times)))
    own = tracker(
        filter=filter,
        motion="cv",
        acceleration_sigma_mps2=1.5,
        initial={"velocity_sigma_mps": 2},
        assume={"lidar": {"correlated_errors": SLOW}},
    )
    c, s = np.cos(yaw), np.sin(yaw)
    expected = [augmented_filter(axis, times, 0.3, 0.8, 1.0, 1.5) for axis in z]
    state = None
    for k, time in enumerate(times):
        seen = np.array([[c, s], [-s, c]]) @ z[:, k]
        state, estimate = own.step(state, scan("lidar", time, seen[:, None], noise=0.09 * np.eye(2), pose=(0, 0, yaw)))
        for axis in (0, 1):
            x, p = expected[axis][k]
            own_axis = [axis, axis + 2]
            np.testing.assert_allclose(estimate.mean[own_axis, 0], x[:2], rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(
                estimate.covariance[np.ix_(own_axis, own_axis)][..., 0], p[:2, :2], rtol=1e-12, atol=1e-12
            )
    assert estimate.mean.shape == (4, 1)


BIASED = {"bias": {"sigmas": {"azimuth_deg": 0.5}}}
KNOWN = {"correlated_errors": SLOW_RADAR, **BIASED}


def nees(estimate: Any, state: Any) -> Any:
    error = estimate.mean - state
    inverse = np.moveaxis(np.linalg.inv(np.moveaxis(estimate.covariance, -1, 0)), 0, -1)
    return np.einsum("ir,ijr,jr->r", error, inverse, error)


def rmse(estimates: list[Any], x: Any, components: slice) -> float:
    errors = [(estimate.mean - state)[components] for estimate, state in zip(estimates, x, strict=True)]
    return float(np.sqrt(np.mean(np.sum(np.square(errors[20:]), axis=1))))


def followed(scans: list[Any], **keys: Any) -> list[Any]:
    """The estimates of a tracker that starts from its first measurement."""
    own, state, result = late_tracker(**{**CV, **keys}), None, []
    for seen in scans:
        state, estimate = own.step(state, seen)
        result.append(estimate)
    return result


@pytest.mark.parametrize("filter", ["ekf", "ukf", "ckf"])
def test_who_assumes_slow_errors_and_a_bias_is_consistent_and_who_does_not_is_optimistic(filter: str) -> None:
    effects = [
        {"type": "correlated_errors", "share": 0.8, "time_s": 1.0},
        {"type": "bias", "sigmas": {"azimuth_deg": 0.5}},
    ]
    x, scans = simulated(Radar(**RADAR, effects=effects), (30.0, 5.0, 4.0, 1.0), steps=80, runs=400)
    knowing = followed(scans, filter=filter, assume={"radar": KNOWN})
    stated = followed(scans, filter=filter)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 4 * 400) / 400
    for k in (20, 40, 60, 79):
        assert low < nees(knowing[k], x[k]).mean() < high
        assert nees(stated[k], x[k]).mean() > 20
    assert rmse(knowing, x, slice(0, 2)) < rmse(stated, x, slice(0, 2))
    assert rmse(knowing, x, slice(2, 4)) < rmse(stated, x, slice(2, 4))
    assert not any(np.any(estimate.repaired) for estimate in knowing if estimate.repaired is not None)


def test_an_imm_of_the_same_model_twice_is_the_filter_alone() -> None:
    _x, scans = simulated(Radar(**RADAR), (30.0, 5.0, 4.0, 1.0), steps=20, runs=10)
    model = {"model": "cv", "acceleration_sigma_mps2": 1.0}
    imm = tracker(filter="ekf", motion={"imm": [model, model], "stay_s": [1, 2]}, assume={"radar": KNOWN})
    state = None
    for seen, expected in zip(scans, followed(scans, filter="ekf", assume={"radar": KNOWN}), strict=True):
        state, estimate = imm.step(state, seen)
        np.testing.assert_allclose(estimate.mean, expected.mean, rtol=1e-9)
        np.testing.assert_allclose(estimate.covariance, expected.covariance, rtol=1e-9, atol=1e-11)


def test_the_jacobians_of_a_state_with_errors_are_finite_differences() -> None:
    keys = {"filter": "ekf", "motion": "ca", "jerk_sigma_mps3": 1, "assume": {"radar": KNOWN}}
    config = FilterConfig.model_validate(keys)
    motion = filter_of(config).motions[0]
    x = np.array([[30.0, 5, 4, 1, 0.3, -0.2, 1, -1, 0.5, 2]]).T
    seen = scan("radar", 0.0, np.zeros((3, 1)))
    for i in range(len(x)):
        step = 1e-6 * np.eye(len(x))[:, [i]]
        ahead, behind = motion.transition(x + step, 0.3), motion.transition(x - step, 0.3)
        np.testing.assert_allclose((ahead - behind)[:, 0] / 2e-6, motion.jacobian(x, 0.3)[:, i], atol=1e-7)
        (above, h), (below, _) = (observe(motion, Radar, x + sign * step, seen) for sign in (1, -1))
        np.testing.assert_allclose((above - below) / 2e-6, h[:, i], atol=1e-6)


def test_a_late_measurement_is_as_if_it_had_come_in_time() -> None:
    _x, scans = simulated(Lidar(**LIDAR), (30.0, 5.0, 4.0, 1.0), steps=12, runs=5)
    # With driving noise that is constant over a step, other steps would be another motion.
    keys = {"filter": "ekf", "acceleration_sigma_mps2": 1e-6, "assume": {"lidar": {"correlated_errors": SLOW}}}
    in_time = followed(scans, **keys)[-1]
    late = scans[-2]._replace(arrival_time=scans[-1].time)
    order = [*scans[:-2], scans[-1], late]
    estimate = followed(order, **keys)[-1]
    np.testing.assert_allclose(estimate.mean, in_time.mean, rtol=1e-6)
    np.testing.assert_allclose(estimate.covariance, in_time.covariance, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("filter", ["ekf", "ukf", "ckf", "imm"])
def test_the_fused_engine_computes_the_same(filter: str) -> None:
    _x, scans = simulated(Radar(**RADAR), (20.0, 5.0, 8.0, 0.5), steps=15, runs=30)
    motions: dict[str, Any] = {"filter": filter, **CV}
    if filter == "imm":
        models = [{"model": "cv", "acceleration_sigma_mps2": 1.0}, {"model": "ca", "jerk_sigma_mps3": 1.0}]
        motions = {"filter": "ekf", "motion": {"imm": models, "stay_s": [1, 2]}}
    for effects in ({"signal_to_noise": SIGNAL}, KNOWN, {"signal_to_noise": SIGNAL, **KNOWN}):
        own = tracker(**motions, assume={"radar": effects})
        fused, states = replace(own, engine="fused"), [None, None]
        for seen in scans:
            states[0], expected = own.step(states[0], seen)
            states[1], estimate = fused.step(states[1], seen)
            np.testing.assert_allclose(estimate.mean, expected.mean, rtol=1e-9)
            np.testing.assert_allclose(estimate.covariance, expected.covariance, rtol=1e-8, atol=1e-10)
        assert fused.engine_used.engine == "fused", fused.engine_used


def test_kf_has_no_errors_as_states(tiny: Path) -> None:
    assuming(tiny, "kf", "{radar: {bias: {sigmas: {range_m: 1}}}}")
    with pytest.raises(TrackbenchError, match=r"kf converts measurements to positions, .*; use ekf"):
        load_scenario(tiny)
