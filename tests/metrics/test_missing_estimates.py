"""Leaving out estimates never pays, whichever are left out."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.support.late_start import write_scene
from tests.support.scenes import block_of, tracker, truth, work

import trackbench as tb
from trackbench.driving.isolation import Isolation
from trackbench.metrics.consistency import whitened_innovation
from trackbench.models.sensors import Lidar, Radar
from trackbench.report.pairs import standing
from trackbench.runner.evaluated import evaluate_trackers
from trackbench.trackers.config import PluginConfig

RUNS, STEPS, DT = 60, 160, 0.05
SENSORS = {
    "radar": Radar(rate_hz=10, phase_s=0.05, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.2),
    "lidar": Lidar(rate_hz=10, position_sigma_m=0.15, detection_probability=0.9),
}
EKF = {
    "filter": "ekf",
    "motion": "cv",
    "acceleration_sigma_mps2": 2.0,
    "initial": {"from": "first_measurement", "velocity_sigma_mps": 20},
}
#: px, py, vx, vy of one that is near, one that leaves and one that is far.
STARTS = np.array([[20.0, 10.0, 8.0, 3.0], [30.0, -20.0, 12.0, -4.0], [90.0, 30.0, 10.0, 0.0]]).T
#: Of the estimates, what is left out at most: a tracker with a smaller share is not ranked.
WORST = 0.049


@cache
def scene():
    """Three objects that move as the EKF assumes: a white acceleration, constant from one instant to the next."""
    noise = np.random.default_rng(4).normal(0.0, 2.0, (STEPS, 2, 3, RUNS))
    none = np.zeros_like(noise[:1])
    velocity = STARTS[2:, :, None] + DT * np.concatenate([none, np.cumsum(noise, axis=0)[:-1]])
    moves = DT * velocity + DT**2 / 2 * noise
    position = STARTS[:2, :, None] + np.concatenate([none, np.cumsum(moves, axis=0)[:-1]])
    return truth(np.arange(STEPS) * DT, position[:, 0], position[:, 1], velocity[:, 0], velocity[:, 1])


def error(time, mean):
    """``(batch,)`` of the position; a tracker cannot know it, which makes the hardest test."""
    of, step = scene(), round(time / DT)
    return np.hypot(*(mean[:2] - np.stack([of.px[step], of.py[step]]).reshape(2, -1)))


class Rule:
    """Which estimates are left out, from what is known after each scan."""

    def __init__(self, batch):
        self.until = np.full(batch, -np.inf)

    def silent(self, scan, estimate):
        raise NotImplementedError


class Nothing(Rule):
    def silent(self, scan, estimate):
        return np.zeros_like(scan.valid)


class FarObjects(Rule):
    def silent(self, scan, estimate):
        return np.hypot(*estimate.mean[:2]) > 60


class AfterLargeInnovations(Rule):
    """For 0.2 s after each that is beyond its 95 % point."""

    def silent(self, scan, estimate):
        white = whitened_innovation(estimate)
        if white is not None:
            large = scan.valid & (np.nansum(white**2, axis=0) > {2: 5.99, 3: 7.81}[len(white)])
            self.until[large] = scan.time + 0.2
        return scan.time < self.until


class LateStart(Rule):
    def silent(self, scan, estimate):
        return np.full(scan.valid.shape, scan.time < 2.0 - 1e-9)


class WorstPositions(Rule):
    """Those whose error is among the largest in truth."""

    def silent(self, scan, estimate):
        return (error(scan.time, estimate.mean) > worst_error()) & (scan.time > 0.2)


class WithoutMeasurements(Rule):
    """Once the position is not known to a few metres."""

    def silent(self, scan, estimate):
        return estimate.covariance[0, 0] > 2.0


class AtRandom(Rule):
    def __init__(self, batch):
        super().__init__(batch)
        self.random = np.random.default_rng(1)

    def silent(self, scan, estimate):
        return self.random.random(scan.valid.size) < 0.05


RULES = {
    rule.__name__: rule
    for rule in (
        Nothing,
        FarObjects,
        AfterLargeInnovations,
        LateStart,
        WorstPositions,
        WithoutMeasurements,
        AtRandom,
    )
}


class Withholding:
    """The EKF, which follows its rule in what it gives."""

    batched = True

    def __init__(self, rule, deaf_from_s=np.inf, **options):
        self.ekf, self.rule, self.deaf_from_s = tracker(**EKF, **options), RULES[rule], deaf_from_s

    def step(self, state, scan):
        rule, inner = state or (self.rule(scan.valid.size), None)
        if scan.time >= self.deaf_from_s:
            scan = scan._replace(valid=np.zeros_like(scan.valid))
        inner, estimate = self.ekf.step(inner, scan)
        silent = rule.silent(scan, estimate)
        return (rule, inner), estimate._replace(mean=np.where(silent, np.nan, estimate.mean))


def plugin(rule, sensors=None, **options):
    return PluginConfig(use=f"{__name__}:Withholding", options={"rule": rule, **options}, sensors=sensors)


def reached(trackers, settle=0.0):
    # In this process, where rules may see the truth.
    here = Isolation(in_process=True)
    whole = replace(work(scene(), SENSORS, trackers, RUNS, settle=settle), min_coverage=0.5, isolation=here)
    block = block_of(whole, range(RUNS))
    return {name: item.values for name, item in evaluate_trackers(whole, [block]).evaluations.items()}


@cache
def worst_error():
    """Above which the worst errors of the position lie, of the tracker that gives all."""
    errors = []

    class Watched(Rule):
        def silent(self, scan, estimate):
            errors.append(error(scan.time, estimate.mean))
            return np.zeros_like(scan.valid)

    RULES["Watched"] = Watched
    reached({"all": plugin("Watched")})
    del RULES["Watched"]
    # Those before are silent for another reason: they are of the start.
    return np.quantile(np.concatenate(errors[5:]), 1 - WORST)


SILENT = [name for name in RULES if name not in ("Nothing", "WithoutMeasurements")]


@cache
def reached_by_rules(settle):
    worst_error()
    return reached({"all": plugin("Nothing"), **{rule: plugin(rule) for rule in SILENT}}, settle)


@pytest.mark.parametrize("settle", [0.0, 1.0])
@pytest.mark.parametrize("rule", SILENT)
def test_leaving_out_estimates_never_pays(rule, settle):
    of = reached_by_rules(settle)
    never_pays({"all": of["all"], "silent": of[rule]})


def never_pays(of):
    """Equal at best, which it is where all that was left out is of the start, and that is not scored."""
    everything, silent = of["all"], of["silent"]
    assert everything["coverage"].value == 1.0
    for path in ("position_rmse", "velocity_rmse"):
        if silent["coverage"].value == 1.0:
            assert silent[path] == everything[path]
            continue
        assert silent[path].value > 1.1 * everything[path].value
        assert silent[path].charged_share > 0.1


def test_a_diverged_tracker_does_not_gain_by_silence():
    """One that takes in nothing from 3 s on: as long as it goes on, and once it gives NaN."""
    goes_on, stops = plugin("Nothing", deaf_from_s=3.0), plugin("WithoutMeasurements", deaf_from_s=3.0)
    of = reached({"all": goes_on, "silent": stops, "sound": plugin("Nothing")}, 1.0)
    assert 0.5 < of["silent"]["coverage"].value < 0.9
    never_pays(of)
    assert of["sound"]["position_rmse"].value < 0.1 * of["all"]["position_rmse"].value


def test_a_matched_covariance_is_not_judged_without_its_worst_estimates():
    every, silent = (reached_by_rules(1.0)[name]["nees"] for name in ("all", "WorstPositions"))
    assert every.verdict == "consistent"
    assert every.value == pytest.approx(4.0, abs=0.1)
    assert silent.value < every.value - 0.2
    assert silent.verdict == "undecided"


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("silence"))


@pytest.fixture(scope="module")
def result(scenario):
    return tb.run(tb.load(scenario))


def test_an_honest_tracker_that_starts_a_moment_later_is_better(result):
    ekf, mine, broken = (result[name] for name in ("ekf", "mine", "broken"))
    assert ekf.metrics["coverage"].value < 0.99
    assert mine.metrics["coverage"].value == broken.metrics["coverage"].value == 1.0
    assert 2 * ekf.position_rmse.value < mine.position_rmse.value < broken.position_rmse.value
    assert all(item.passed for item in result.summary.expectations)
    best, *others = standing(result).cells
    assert not any(set(best) & set(other) for other in others)
