"""What a tracker reaches is its own; what is independent: scenes, runs, stretches of one run."""

from dataclasses import replace

import numpy as np
import pytest
from tests.metrics.test_metrics_scorer import SENSORS, TWO, estimate, scored, target
from tests.support.scenes import SHARED, block_of, random_walk, scan, truth, values, work

from trackbench.metrics import Interval, evaluate
from trackbench.metrics.built_in.basic import PositionRmse
from trackbench.metrics.differences import tracker_differences
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import independent_scores
from trackbench.metrics.sums import ERROR, merge, stretch_numbers
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.models.sensors.base import Dropout
from trackbench.results import MetricValue
from trackbench.results.scenario_summary import MarginSummary
from trackbench.runner.evaluated import evaluate_trackers
from trackbench.runner.loop import run_block
from trackbench.runner.targets import Targets
from trackbench.runner.work import BlockRuns, Scene
from trackbench.sensing.scans import ideal_sensors, sense_known
from trackbench.trackers.config import PluginConfig


class Silent:
    """The latest position, but only of the runs whose first one is on the near side."""

    def step(self, state, seen):
        x, y = state or (0.0, 0.0)
        if seen.valid and not np.isnan(x):
            x, y = SENSOR_MODELS[seen.kind].position(seen).mean
        if state is None and x > 40:
            x = np.nan
        return (x, y), None if np.isnan(x) else (np.array([x, y, 10.0, 5.0]), np.eye(4))


def test_what_a_tracker_reaches_does_not_depend_on_those_beside_it():
    of = random_walk(12, 40, 0.05, 2.0, seed=1, start=np.array([40.0, 10.0, 10.0, 5.0]))
    trackers = {**TWO, "silent": PluginConfig(use=f"{__name__}:Silent")}
    whole = replace(work(of, SENSORS, trackers, 12), min_coverage=0.9)
    found = evaluate_trackers(whole, [block_of(whole, range(12))])
    assert set(found.ranked) == set(TWO)
    for name in trackers:
        without = replace(work(of, SENSORS, {name: trackers[name]}, 12), min_coverage=0.9)
        alone = evaluate_trackers(without, [block_of(without, range(12))]).evaluations[name]
        assert {path: value for path, value in found.evaluations[name].values.items() if path != "step_time"} == {
            path: value for path, value in alone.values.items() if path != "step_time"
        }
    silent = found.evaluations["silent"].values
    assert silent["coverage"].value < 0.6
    assert silent["velocity_rmse"].value > 2 * silent["velocity_rmse"].without_charged


def test_innovations_that_are_missing_or_impossible_are_counted():
    # A tracker with an estimate from the first instant on gives an innovation at each second measurement, then one
    # with an indefinite covariance.
    good, none = np.array([[1.0], [0.0]]), np.full((2, 1), np.nan)
    eye, indefinite = np.eye(2)[..., None], np.diag([1.0, -1.0])[..., None]
    rows = [(none, eye), (good, eye), (none, eye), (good, eye), (good, indefinite)]
    seen = [[scan("lidar", float(k), np.zeros((2, 1)))] for k in range(5)]
    given = [
        estimate(np.zeros((4, 1)), innovation=innovation, innovation_covariance=covariance)
        for innovation, covariance in rows
    ]
    scores = scored(target(np.zeros((4, 5, 1)), 1), list(zip(seen, given, strict=True)), {"lidar": 5})
    nis = values(scores)["nis.lidar"]
    # None is due at the first measurement, before which there was no estimate.
    assert nis.coverage == 2 / 4
    assert nis.mean == 1.0


def scenes(count, runs):
    """The same sensors and trackers in several scenes, each with a truth of its own."""
    start = np.array([40.0, 10.0, 10.0, 5.0])
    truths = [random_walk(1, 40 + 5 * k, 0.05, 2.0, seed=k, start=start) for k in range(count)]
    whole = work(truths[0], SENSORS, TWO, runs)
    return replace(whole, scenes=[Scene(of, ideal_sensors(of, SENSORS)) for of in truths])


def test_scenes_are_what_is_independent():
    whole = scenes(3, 4)
    found = evaluate_trackers(whole, [run_block(whole, piece) for piece in whole.pieces()])
    assert whole.scene_of_run.tolist() == [0] * 4 + [1] * 4 + [2] * 4
    for name in found.ranked:
        interval = found.evaluations[name].intervals["position_rmse"]
        assert interval.influence.shape == (3,)
        assert interval.influence.sum() == pytest.approx(0.0, abs=1e-12)
        total = np.stack(
            [found.evaluations[name].scores.per_run[:, 4 * k : 4 * k + 4].sum(axis=1) for k in range(3)], axis=1
        )
        expected = np.sqrt(total[1:3].sum() / total[0].sum())
        assert found.evaluations[name].values["position_rmse"].value == pytest.approx(expected, rel=1e-12)


def test_a_scene_s_runs_do_not_depend_on_the_other_scenes_nor_on_their_number():
    three, one = scenes(3, 4), scenes(1, 6)
    first = run_block(three, BlockRuns(0, range(4)))
    longer = run_block(one, BlockRuns(0, range(6)))
    assert first.digests == longer.digests[:4]
    second, third = (run_block(three, BlockRuns(k, range(4))) for k in (1, 2))
    assert not set(second.digests) & {*first.digests, *third.digests}
    again = run_block(replace(three, runs=9), BlockRuns(1, range(9)))
    assert again.digests[:4] == second.digests


def test_scenes_of_different_length_are_added_instant_by_instant():
    whole = scenes(2, 2)
    short, long = (run_block(whole, piece).outcomes["raw"].scores for piece in whole.pieces())
    both = merge([short, long])
    count = both.per_step[ERROR["count"]]
    assert len(count) == len(whole.scenes[1].instants()) > len(whole.scenes[0].instants())
    np.testing.assert_array_equal(
        count[: short.per_step.shape[1]], short.per_step[0] + long.per_step[0][: short.per_step.shape[1]]
    )
    assert both.due.shape == (4,)


@pytest.mark.parametrize(("share", "alone", "better"), [(0.05, 0.3, "a"), (0.2, 0.15, "a"), (0.2, 0.05, None)], ids=str)
def test_nobody_is_better_for_what_the_other_is_charged_with_alone(share, alone, better):
    spread = 1e-3 * (-1.0) ** np.arange(50)
    found = {name: {"position_rmse": Interval(value, spread)} for name, value in (("a", 0.1), ("b", 0.2))}
    charged = MetricValue(value=0.2, unit="m", charged_share=share, without_charged=alone)
    of = {"a": {"position_rmse": MetricValue(value=0.1, unit="m")}, "b": {"position_rmse": charged}}
    margin = MarginSummary(percent=1, position_m=0.005, velocity_mps=0.02, course_deg=0.05)
    (item,) = tracker_differences(found, [PositionRmse()], margin, of)
    (mirrored,) = tracker_differences(dict(reversed(found.items())), [PositionRmse()], margin, of)
    assert (item.better, mirrored.better, item.turned) == (better, better, better is None)
    assert item.p_value < 0.05
    if better is None:
        assert (item.verdict, mirrored.verdict) == ("smaller", "larger")


def test_an_object_out_of_view_of_every_sensor_is_not_scored_for_long():
    # Away from the sensor at 20 m/s, out of range from 2 s on.
    time = np.arange(60) * 0.1
    of = truth(time, *(values[:, None, None] for values in (10 + 20 * time, 0 * time, 20 + 0 * time, 0 * time)))
    near = {"lidar": SENSORS["lidar"].model_copy(update={"max_range_m": 50.0, "detection_probability": 1.0})}
    for lost_after, last in ((1.0, 3.0), (2.5, 4.5)):
        whole = replace(work(of, near, {"ekf": TWO["ekf"]}, 2), lost_after=lost_after)
        count = block_of(whole, range(2)).outcomes["ekf"].scores.per_step[ERROR["count"]]
        assert time[np.flatnonzero(count)[-1]] == pytest.approx(last)


def test_an_object_that_comes_back_is_scored_from_its_next_detection():
    # Out of range from 2 s to 4 s. The first detection after it is that at 4.0 s, or a later one where that is missed.
    time = np.arange(80) * 0.1
    away = 3 - time
    of = truth(time, *(v[:, None, None] for v in (70 - 20 * np.abs(away), 0 * time, 20 * np.sign(away), 0 * time)))
    for probability, settle in ((1.0, 0.0), (1.0, 0.5), (0.3, 0.0), (0.3, 0.5)):
        lidar = SENSORS["lidar"].model_copy(update={"max_range_m": 50.0, "detection_probability": probability})
        whole = replace(work(of, {"lidar": lidar}, {"ekf": TWO["ekf"]}, 40), settle=settle, lost_after=1.0)
        measured = sense_known(whole.scenes[0].sensors, whole.seed, whole.noise_of(0), range(40))
        due = Targets(whole, BlockRuns(0, range(40)), measured).due[:, 0]
        instants = whole.scenes[0].truth.time[whole.scenes[0].instants()]
        valid = np.stack([scan.valid for scan in measured.scans]).reshape(len(instants), 40)
        again = instants > 3.05
        for run in range(40):
            first = instants[valid[:, run] & again][0]
            assert first >= 3.95
            np.testing.assert_array_equal(due[again, run], instants[again] >= first + settle - 1e-9)


def test_silence_of_a_sensor_is_no_excuse():
    time = np.arange(60) * 0.1
    of = truth(time, *(values[:, None, None] for values in (10 + 2 * time, 0 * time, 2 + 0 * time, 0 * time)))
    silent = {"lidar": SENSORS["lidar"].model_copy(update={"dropouts": (Dropout(from_s=2, to_s=5),)})}
    count = block_of(work(of, silent, {"ekf": TWO["ekf"]}, 2), range(2)).outcomes["ekf"].scores.per_step[ERROR["count"]]
    assert (count[5:] == 2).all()


def test_a_single_run_is_cut_into_stretches_of_time():
    of = random_walk(1, 201, 0.05, 2.0, seed=3, start=np.array([40.0, 10.0, 10.0, 5.0]))
    whole = work(of, SENSORS, TWO, 1)
    (scores,) = (block_of(whole, range(1)).outcomes[name].scores for name in ("ekf",))
    parts = independent_scores(scores, np.zeros(1, dtype=np.intp))
    assert parts.per_part.shape == (len(ERROR), 2), "ten seconds, none shorter than four"
    np.testing.assert_allclose(parts.per_part.sum(axis=1), scores.per_run[:, 0], rtol=1e-12)
    stretch = stretch_numbers(len(whole.scenes[0].instants()), 10.0)
    expected = np.bincount(stretch, scores.per_step[ERROR["px"]])
    np.testing.assert_allclose(parts.per_part[ERROR["px"]], expected, rtol=1e-12)
    assert parts.classes[0][1].total[0, 0] == scores.per_run[0, 0]
    # The moments over stretches are those of the sums themselves.
    position = parts.per_part[ERROR["px"]] + parts.per_part[ERROR["py"]]
    assert parts.classes[0][1].square[2, 0] == pytest.approx((position**2).sum(), rel=1e-12)
    found = evaluate({ESTIMATES.name: scores}, np.zeros(1, dtype=np.intp), SHARED).values
    low, high = found["position_rmse"].ci95
    assert low < found["position_rmse"].value < high
