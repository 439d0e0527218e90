"""Intervals of runs from several scenes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.intervals import scaled

from trackbench.metrics import clustered, ratio, root
from trackbench.metrics.contrasts import paired, turning_factor, undrawn_share, unpaired
from trackbench.metrics.intervals import FEWEST_SCENES, TOO_FEW_SCENES
from trackbench.metrics.traffic import TRACK_METRICS


def sums(seed: int, scenes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Totals, numbers of terms and scenes of runs whose scenes differ in size and in order."""
    random = np.random.default_rng(seed)
    scene = random.permutation(np.repeat(np.arange(scenes) * 3, random.integers(1, 6, scenes)))
    count = random.integers(1, 50, len(scene)).astype(float)
    return count * random.lognormal(size=len(scene)), count, scene


def by_scene(values: np.ndarray, scene: np.ndarray) -> np.ndarray:
    return np.array([values[scene == one].sum() for one in np.unique(scene)])


@given(st.integers(0, 10_000), st.integers(FEWEST_SCENES, 12))
def test_clustering_is_the_ratio_of_sums_by_scene(seed: int, scenes: int) -> None:
    total, count, scene = sums(seed, scenes)
    expected = ratio(by_scene(total, scene), by_scene(count, scene), scenes=True)
    found = clustered(ratio(total, count), scene)
    assert found.value == pytest.approx(expected.value)
    assert found.influence == pytest.approx(expected.influence, abs=1e-12)
    assert found.ci95 == pytest.approx(expected.ci95)
    assert abs(found.influence.mean()) < 1e-9
    error = clustered(scaled(root(ratio(total, count)), 3.0), scene)
    assert error.ci95 == pytest.approx(scaled(root(expected), 3.0).ci95)


@given(st.integers(0, 10_000))
def test_paired_differences_cluster_like_those_of_sums_by_scene(seed: int) -> None:
    total, count, scene = sums(seed, 7)
    other = total * np.random.default_rng(seed).lognormal(size=len(total))
    found = paired(*(clustered(ratio(values, count), scene) for values in (total, other)))
    expected = paired(
        *(ratio(by_scene(values, scene), by_scene(count, scene), scenes=True) for values in (total, other))
    )
    assert found.ci95 == pytest.approx(expected.ci95)
    assert found.p_value == pytest.approx(expected.p_value)


def test_one_scene_changes_nothing() -> None:
    total, count, scene = sums(3, 4)
    found = ratio(total, count)
    assert clustered(found, np.full_like(scene, 5)) is found


def test_scenes_of_one_run_each_are_still_scenes() -> None:
    total, count, _ = sums(3, 9)
    found = ratio(total, count, at_least=0.0)
    of_scenes = clustered(found, np.arange(len(total)))
    assert of_scenes.influence == pytest.approx(found.influence)
    assert of_scenes.ci95 == pytest.approx(found._replace(scenes=True).ci95)
    assert of_scenes.ci95[1] > found.ci95[1]


def test_fewer_scenes_than_the_rule_holds_for_give_no_interval_and_no_verdict() -> None:
    total, count, _ = sums(3, 9)
    few, enough = (ratio(total[:size], count[:size], scenes=True) for size in (FEWEST_SCENES - 1, FEWEST_SCENES))
    assert few.ci95 is None
    assert few.as_value("m").reason == TOO_FEW_SCENES
    assert enough.ci95 is not None
    for contrast in (paired(few, scaled(few, 3.0)), unpaired(few, enough), unpaired(enough, few)):
        assert contrast.ci95 is None
        assert contrast.p_value == 1.0
    assert paired(enough, scaled(enough, 3.0)).ci95 is not None


@pytest.mark.parametrize("compare", [paired, unpaired])
def test_a_difference_of_errors_over_scenes_reaches_further_by_what_they_do_not_show(compare) -> None:
    squares = np.random.default_rng(4).lognormal(sigma=0.1, size=(2, 9))
    a, b = root(ratio(squares[0], np.ones(9))), root(ratio(4.0 * squares[1], np.ones(9)))
    value, of_runs, *_ = compare(a, b)
    over_scenes = [item._replace(scenes=True) for item in (a, b)]
    reach = (1 + 1.5 / 3) * (of_runs[1] - value) + 0.1 * a.value / 3
    assert compare(*over_scenes).ci95 == pytest.approx((value - reach, value + reach))
    # The p-value is below 5 % where the interval lies beside the margin.
    assert compare(*over_scenes, margin=0.99 * (-value - reach)).p_value < 0.05
    assert compare(*over_scenes, margin=1.01 * (-value - reach)).p_value > 0.05
    # Where one scene of a hundred may decide, the larger must be more than 1.5 times the smaller; the interval stays.
    few = [item._replace(few_decide=True) for item in over_scenes]
    assert compare(*few).ci95 == compare(*over_scenes).ci95
    assert compare(*few).p_value < 0.05
    near = [few[0], scaled(few[1], 0.7)]
    assert compare(*near).p_value > 0.05
    assert compare(*(item._replace(few_decide=False) for item in near)).p_value < 0.05
    # What is no error has no such term.
    shares = [item._replace(at_most=9.0) for item in over_scenes]
    assert compare(*shares).ci95[1] == pytest.approx(value + (1 + 1.5 / 3) * (of_runs[1] - value))


def test_intervals_from_scenes_cover_where_those_from_runs_do_not() -> None:
    random = np.random.default_rng(5)
    scene = np.repeat(np.arange(10), 20)
    inside = np.zeros(2)
    for _ in range(1000):
        values = random.normal(size=10)[scene] + random.normal(size=200)
        found = ratio(values, np.ones(200))
        inside += [low <= 0.0 <= high for low, high in (found.ci95, clustered(found, scene).ci95)]
    assert inside[0] < 600
    assert 930 <= inside[1] <= 970


def test_intervals_of_stretches_whose_neighbours_are_alike_cover_too() -> None:
    random, parts = np.random.default_rng(6), np.arange(12)
    inside = np.zeros(3)
    for _ in range(1000):
        noise = random.normal(size=(2, 13))
        one, other = noise[:, 1:] + 0.6 * noise[:, :-1]
        plain, mean, against = (
            clustered(ratio(values, np.ones(12)), parts, in_time=in_time)
            for values, in_time in ((one, False), (one, True), (other, True))
        )
        low, high = paired(mean, against).ci95
        inside += [plain.ci95[0] <= 0 <= plain.ci95[1], mean.ci95[0] <= 0 <= mean.ci95[1], low <= 0 <= high]
    assert inside[0] < 890
    assert 900 <= inside[1] <= 980
    assert 900 <= inside[2] <= 990


@pytest.mark.parametrize(
    ("path", "runs", "reason"),
    [
        ("tgospa", 49, "no valid interval with fewer than 50 runs"),
        ("tgospa", 50, None),
        ("false_tracks", 9, "no valid interval with fewer than 10 runs"),
        ("false_tracks", 10, None),
        ("position_rmse", 399, "no valid interval with fewer than 400 runs"),
        ("position_rmse", 400, None),
        ("velocity_rmse", 1000, "no valid interval over runs: a few of them decide the value"),
        ("tgospa", 1, "too short for an interval"),
    ],
)
def test_tracks_have_an_interval_from_as_many_runs_as_calibrate_it(path, runs, reason):
    """A difference of two trackers, which is calibrated by itself, and scenes do not take so many."""
    totals = np.random.default_rng(1).gamma(4.0, size=(2, runs))
    own, other = (TRACK_METRICS[path].of_runs(total, np.full(runs, 9.0)) for total in totals)
    value = own.as_value("m")
    assert value.reason == reason
    assert (value.ci95 is None) == bool(reason)
    assert (paired(own, other).ci95 is None) == (runs == 1)
    if runs > 1:
        scenes = clustered(own, np.arange(runs) % FEWEST_SCENES)
        assert scenes.ci95 is not None
        assert clustered(own, np.arange(runs) % (FEWEST_SCENES - 1)).as_value("m").reason == TOO_FEW_SCENES


def test_a_kind_of_scene_is_left_out_as_often_as_stated_and_turns_the_order_from_the_factor_on() -> None:
    for scenes in (5, 10, 40):
        share, factor = undrawn_share(scenes), turning_factor(scenes)
        assert share == pytest.approx(3 / scenes, rel=0.3)
        random = np.random.default_rng(scenes)
        undrawn = (random.random((20_000, scenes)) >= share).all(axis=1)
        assert undrawn.mean() == pytest.approx(0.05, abs=0.005)
        assert (1 - share) * 1.0 - share * factor == pytest.approx(0.0)
