"""Verdicts on a covariance"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np

import trackbench as tb
from trackbench.metrics.verdicts import ABOVE, BELOW, DOUBT, SMALLEST_SHARE, TOLERANCE, doubtless_verdict

from .claim import Claim, power, rate

SEEDS = 200
#: Repeats of few runs, and the instants of each.
PARTS, STEPS = 20_000, 50
#: Scenarios whose truth moves as the trackers assume, with the trackers whose assumptions are right.
SOUND = {"scripted/own_model": ("kf_lidar", "ekf"), "scripted/own_model_ctrv": ("ukf", "ckf")}
#: The process noise of their truths, as options of a tracker.
NOISE = {
    "scripted/own_model": {"acceleration_sigma_mps2": 2.0},
    "scripted/own_model_ctrv": {"acceleration_sigma_mps2": 1.0, "yaw_acceleration_sigma_radps2": 0.3},
}
#: By what they are multiplied to be wrong, and what the tracker then is.
FACTORS = {1.4: "pessimistic", 1 / 1.4: "optimistic"}
#: By scenario and seed of the truth, with the simulator's own steering, noises of trackers with which the mean NEES
#: over all estimates is within 10 % of 4.
RIGHT_ON_AVERAGE = {
    ("highway", 13): {"ekf_cv.acceleration_sigma_mps2": 2.7, "ekf_ca.jerk_sigma_mps3": 11},
    ("highway_dense", 7): {"ekf_cv.acceleration_sigma_mps2": 4},
    ("fusion", 15): {"ekf_cv.acceleration_sigma_mps2": 2.9, "ekf_ca.jerk_sigma_mps3": 12},
    ("radar_only", 15): {"ekf_cv.acceleration_sigma_mps2": 2.8, "ekf_ca.jerk_sigma_mps3": 7},
    ("sensor_dropout", 15): {"ekf_cv.acceleration_sigma_mps2": 2.7, "ekf_ca.jerk_sigma_mps3": 10.5},
}


def claims() -> Iterator[Claim]:
    """Sound filters and smoothers are consistent, filters that are off are not, and more runs turn no verdict round."""
    for scenario, trackers in SOUND.items():
        found = _verdicts(scenario, trackers, {}, 100)
        for name in trackers:
            hits = [verdicts[name] == "consistent" for verdicts in found]
            yield rate(f"{scenario} {name}, 100 runs: consistent", hits, 0.95, 1.0)
        yield from _power(scenario, trackers, {}, 100, "", 0.95)
        smoothers = {f"trackers.{name}.smoother": "rts" for name in trackers}
        found = _verdicts(scenario, trackers, smoothers, 100, SEEDS // 2)
        for name in trackers:
            # Their errors go on for longer, so that as many runs tell less.
            hits = [verdicts[name] in ("consistent", "undecided") for verdicts in found]
            yield rate(f"{scenario} {name} with its smoother, 100 runs: consistent or undecided", hits, 0.95, 1.0)
        yield from _power(scenario, trackers, smoothers, 100, " with its smoother")
    yield from _nearly_right()
    yield from _bias()
    yield from _doubtless()
    for scenario, seed in RIGHT_ON_AVERAGE:
        for name, nees in right_on_average(scenario, seed, 100).items():
            off = [f"{item.name} {item.mean:.1f}" for item in nees.conditions or () if item.verdict != "consistent"]
            measured = f"{nees.verdict} ({nees.value:.2f}; {', '.join(off)})"
            yield Claim(f"{scenario} {name}, NEES by condition", measured, "mixed", nees.verdict == "mixed")


def right_on_average(scenario: str, seed: int, runs: int) -> dict[str, Any]:
    """By tracker, its NEES."""
    noises = {f"trackers.{key}": value for key, value in RIGHT_ON_AVERAGE[scenario, seed].items()}
    trackers = [key.partition(".")[0] for key in RIGHT_ON_AVERAGE[scenario, seed]]
    changes = {"truth.steering_rate_degps": None, "truth.seed": seed, **noises}
    result = tb.run(tb.load(scenario, changes, runs=runs, trackers=trackers))
    return {name: result[name].nees for name in trackers}


def _verdicts(
    scenario: str, trackers: tuple[str, ...], changes: Mapping[str, Any], runs: int, seeds: int = SEEDS
) -> list[dict[str, str | None]]:
    """By tracker, with each seed."""
    results = (tb.run(tb.load(scenario, changes, runs=runs, seed=seed, trackers=trackers)) for seed in range(seeds))
    return [{name: result[name].nees.verdict for name in trackers} for result in results]


def _times(scenario: str, trackers: tuple[str, ...], factor: float) -> dict[str, float]:
    """The process noise of the truth times a factor, as changes of the scenario."""
    return {f"trackers.{name}.{key}": factor * value for name in trackers for key, value in NOISE[scenario].items()}


def _power(
    scenario: str, trackers: tuple[str, ...], changes: Mapping[str, Any], runs: int, what: str, least: float = 0.0
) -> Iterator[Claim]:
    """How often a process noise that is wrong is called so."""
    for factor, word in FACTORS.items():
        verdicts = _verdicts(scenario, trackers, {**changes, **_times(scenario, trackers, factor)}, runs, SEEDS // 4)
        for name in trackers:
            hits = [item[name] == word for item in verdicts]
            yield power(
                f"{scenario} {name}{what}, process noise sigma times {factor:.2f}, {runs} runs: {word}", hits, least
            )


def _doubtless() -> Iterator[Claim]:
    """Few parts: a consistent filter, with errors that are correlated from instant to instant, is not called wrong."""
    random = np.random.default_rng(3)
    for parts, correlation in product((1, 2, 3, 5), (0.0, 0.9, 0.99, 1.0)):
        errors = random.standard_normal((4, PARTS, parts))
        nees = np.zeros((PARTS, parts))
        for _ in range(STEPS):
            errors = correlation * errors + (1 - correlation**2) ** 0.5 * random.standard_normal(errors.shape)
            nees += (errors**2).sum(axis=0) / STEPS
        for factor in (1.0, 1 + TOLERANCE, 1 - TOLERANCE):
            words = [doubtless_verdict(mean, parts, 4) for mean in (factor * nees.mean(axis=1)).tolist()]
            what = f"{parts} runs, autocorrelation {correlation:g}, NEES {4 * factor:.3g}: called wrong from few runs"
            yield rate(what, [word != "undecided" for word in words], 0.0, 2 * DOUBT)


def _nearly_right() -> Iterator[Claim]:
    """A process noise variance 20 % too large: a mean NEES 6 % too small, which is without consequence."""
    changes, seeds = _times("scripted/own_model", ("kf_lidar",), 1.2**0.5), SEEDS // 2
    # The runs of a seed are the first of those of more runs.
    by_runs = {
        runs: [item["kf_lidar"] for item in _verdicts("scripted/own_model", ("kf_lidar",), changes, runs, seeds)]
        for runs in (50, 100, 400)
    }
    for runs, found in by_runs.items():
        counted = Counter(found)
        measured = ", ".join(f"{word} {100 * counted[word] / seeds:.0f} %" for word in sorted(map(str, counted)))
        off = counted["pessimistic"] + counted["optimistic"] + counted["mixed"]
        what = f"process noise variance times 1.2, {runs} runs: consistent or undecided"
        yield Claim(what, f"{measured} of {seeds}", "at least 95 %", off <= 0.05 * seeds, excess=off / seeds - 0.05)
        if runs != 100:
            yield from _power("scripted/own_model", ("kf_lidar",), {}, runs, "")
    decided = [[word for word in words if word != "undecided"] for words in zip(*by_runs.values(), strict=True)]
    turned = [len(set(words)) > 1 for words in decided]
    yield rate("the same: one verdict at 50, 100 or 400 runs and another one at more", turned, 0.0, 0.05)


def _bias() -> Iterator[Claim]:
    """The mean NEES of sound filters under each condition, which depends on what their truth did."""
    found: list[tuple[float, str]] = []
    for speed, sigma, lidar in product((5, 15, 30), (0.5, 2, 5), (0.05, 0.15, 1.0)):
        noise = {"acceleration_sigma_mps2": sigma}
        found += _means("own_model", "kf_lidar", "cv", noise, speed, lidar, 300)
    for speed, sigma, yaw, lidar in product((10, 25), (1, 3), (0.05, 0.3, 1.0), (0.15, 1.0)):
        noise = {"acceleration_sigma_mps2": sigma, "yaw_acceleration_sigma_radps2": yaw}
        found += _means("own_model_ctrv", "ukf", "ctrv", noise, speed, lidar, 200)
    (least, where_least), (most, where_most) = min(found), max(found)
    wanted = f"{4 * (1 - BELOW):g} to {4 * (1 + ABOVE):g}"
    for what, mean, where in (("smallest", least, where_least), ("largest", most, where_most)):
        within = 4 * (1 - BELOW) <= mean <= 4 * (1 + ABOVE)
        yield Claim(
            f"{what} mean NEES of a sound filter under a condition with {100 * SMALLEST_SHARE:g} % of the estimates, "
            f"of {len(found)}",
            f"{mean:.2f} ({where})",
            wanted,
            within,
        )


def _means(
    scenario: str, tracker: str, motion: str, noise: Mapping[str, float], speed: float, lidar: float, runs: int
) -> Iterator[tuple[float, str]]:
    """Of each condition that is judged, with its name."""
    changes: dict[str, Any] = {"sensors.lidar.position_sigma_m": lidar}
    for body in ("ahead", "left"):
        changes[f"truth.objects.{body}.pieces"] = [{"white": {"motion": motion, **noise}}]
        changes[f"truth.objects.{body}.start.speed_mps"] = speed
    changes |= {f"trackers.{tracker}.{key}": value for key, value in noise.items()}
    result = tb.run(tb.load(f"scripted/{scenario}", changes, runs=runs, seed=3, trackers=(tracker,)))
    label = ", ".join(f"{value:g}" for value in noise.values())
    for item in result[tracker].nees.conditions or ():
        if np.isfinite(item.mean):
            yield item.mean, f"{item.name}, {motion} sigma {label}, {speed} m/s, lidar {lidar:g} m"
