"""Mean ranks over scenarios: their intervals, and which of them differ."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from tests.support.scenes import truth

from trackbench.base.types import RecordedDetections
from trackbench.compare.comparison import Entrant, EntrantScore
from trackbench.compare.ranking import (
    ALL_SIGNS,
    Pairings,
    fewest_sets,
    mean_rank_interval,
    ranked_trackers,
    sets_of_scenes,
    sign_flip,
)
from trackbench.runner.assemble import scene_fingerprint


def test_the_p_value_is_that_of_scipy() -> None:
    random = np.random.default_rng(3)
    differences = random.integers(-4, 5, (5, 9)) / 2
    for row, p_value in zip(differences, sign_flip(differences), strict=True):
        found = stats.permutation_test((row, -row), lambda a, b, axis: a.mean(axis) - b.mean(axis),
                                       permutation_type="samples", n_resamples=np.inf, vectorized=True)  # fmt: skip
        assert p_value == pytest.approx(found.pvalue)


def test_no_smaller_p_value_than_the_number_of_scenarios_allows() -> None:
    for scenarios in (1, 2, 3, 5, ALL_SIGNS):
        assert sign_flip(np.ones((1, scenarios)))[0] == pytest.approx(2.0 ** (1 - scenarios))
    assert sign_flip(np.zeros((1, 5)))[0] == 1.0
    assert 0 < sign_flip(np.ones((1, ALL_SIGNS + 8)))[0] < 0.001


def test_drawn_signs_agree_with_all_of_them() -> None:
    row = np.random.default_rng(1).integers(-2, 4, ALL_SIGNS + 1) / 2
    signs = np.array([*product((1.0, -1.0), repeat=len(row))])
    exact = (np.abs(signs @ row) >= abs(row.sum())).mean()
    assert sign_flip(row[None])[0] == pytest.approx(exact, abs=0.01)


def test_a_scenario_in_which_both_are_alike_changes_nothing() -> None:
    row = np.array([[1.0, -1.0, 2.0, 1.0, 1.0]])
    assert sign_flip(np.hstack([row, [[0.0]]])) == pytest.approx(sign_flip(row))


@pytest.mark.parametrize(("trackers", "fewest"), [(2, 6), (3, 7), (4, 8), (6, 10), (13, 12)])
def test_fewest_sets(trackers: int, fewest: int) -> None:
    pairs = trackers * (trackers - 1) / 2
    assert fewest_sets(trackers) == fewest
    assert pairs * sign_flip(np.ones((1, fewest)))[0] < 0.05
    assert pairs * sign_flip(np.ones((1, fewest - 1)))[0] >= 0.05


@given(st.lists(st.floats(1, 6), min_size=3, max_size=30))
def test_an_interval_holds_the_mean_and_stays_among_the_ranks(ranks: list[float]) -> None:
    found = mean_rank_interval(np.array(ranks), 6)
    assert found is not None
    assert 1.0 <= found[0] <= np.mean(ranks) + 1e-9
    assert np.mean(ranks) - 1e-9 <= found[1] <= 6.0


def test_always_first_is_not_known_to_be_always_first() -> None:
    few, many = (mean_rank_interval(np.ones(scenarios), 6) for scenarios in (5, 50))
    assert few is not None
    assert many is not None
    assert few[0] == many[0] == 1.0
    assert few[1] > many[1] > 1.0


@pytest.mark.parametrize(("scenarios", "trackers"), [(2, 6), (13, 3)])
def test_no_interval_from_too_few(scenarios: int, trackers: int) -> None:
    assert mean_rank_interval(np.linspace(1, trackers, scenarios), trackers) is None


def score(scenario: str, name: str, rank: float | None) -> EntrantScore:
    return EntrantScore(
        scenario=scenario,
        entrant=Entrant(tracker=name),
        metrics={},
        diverged_runs=0,
        rank=rank,
        leading=False,
        failure="" if rank else "none",
    )


def test_ranks_of_a_scenario_add_up_whoever_has_a_score() -> None:
    scored = [score("one", name, rank) for name, rank in zip("abcd", (1.5, 1.5, None, None), strict=True)]
    scored += [score("two", name, rank) for name, rank in zip("abcd", (2, 1, 4, 3), strict=True)]
    found, pairs = ranked_trackers(scored, Pairings([], "position_rmse"), [["one"], ["two"]])
    assert {item.tracker: item.mean_rank for item in found} == {"b": 1.25, "a": 1.75, "d": 3.25, "c": 3.75}
    assert [(item.a, item.b) for item in pairs] == [
        ("b", "a"),
        ("b", "d"),
        ("b", "c"),
        ("a", "d"),
        ("a", "c"),
        ("d", "c"),
    ]


class ByName(Pairings):
    """In scenarios of one's own the first name is better, in copies the last."""

    def __init__(self) -> None:
        super().__init__([], "")

    def better(self, scenario: str, a: str, b: str) -> str | None:
        return min(a, b) if scenario.startswith("own") else max(a, b)


def test_scenarios_that_share_scenes_count_once() -> None:
    """Ten copies of one scenario are no more than one of it."""
    own, copies = (
        [score(f"{kind} {number}", name, float(rank)) for number in range(count) for rank, name in enumerate(names, 1)]
        for kind, count, names in (("own", 9, "abcd"), ("copy", 10, "dcba"))
    )
    singles = [[f"own {number}"] for number in range(9)]
    many = ranked_trackers(own + copies, ByName(), [*singles, [f"copy {number}" for number in range(10)]])
    once = ranked_trackers(own + copies[:4], ByName(), [*singles, ["copy 0"]])
    for item, same in zip(many[0], once[0], strict=True):
        assert (item.tracker, item.mean_rank) == (same.tracker, pytest.approx(same.mean_rank))
        assert item.ci95 == pytest.approx(same.ci95)
    assert many[1] == once[1]
    assert many[0][0].tracker == "a"
    apart, _ = ranked_trackers(own + copies, ByName(), [*singles, *([f"copy {number}"] for number in range(10))])
    assert apart[0].tracker == "d"


def test_a_longer_or_finer_record_of_the_same_traffic_is_the_same_scene() -> None:
    def recorded(duration: float, rate: float, speed: float = 10.0, later: float = np.nan) -> str:
        time = np.arange(round(duration * rate) + 1) / rate
        x = np.stack([speed * time, 40.0 - 3.0 * time, np.where(time > 6.0, later, np.nan)], axis=1)[:, :, None]
        return scene_fingerprint(truth(time, x, 0.0 * x, 0.0 * x, 0.0 * x))

    def sets(*fingerprints: str) -> int:
        return len(sets_of_scenes({str(i): [fingerprint] for i, fingerprint in enumerate(fingerprints)}))

    whole = recorded(20, 10)
    assert whole == recorded(20, 15)
    assert sets(whole, recorded(19.9, 10), recorded(4, 10), recorded(4, 10, later=7.0)) == 1
    assert sets(whole, recorded(20, 10, speed=10.1)) == 2
    # What agrees for six seconds only is no record of the same.
    assert sets(whole, recorded(20, 10, later=7.0)) == 2


def test_logs_without_a_truth_are_told_apart_by_their_measurements() -> None:
    def log(first: float) -> str:
        empty = np.zeros((2, 0, 1))
        unknown = replace(truth(np.arange(2.0), empty, empty, empty, empty), known=False)
        steps, track = np.array([0, 1]), np.array([-1, -1])
        read = RecordedDetections(steps, steps, np.array([[first, 2.0]]), track, ())
        return scene_fingerprint(unknown, {"radar": read})

    assert log(1.0) == log(1.0)
    assert log(1.0) != log(1.5)


def test_sets_join_what_shares_a_scene_by_way_of_others() -> None:
    scenes = {"a": ["1", "2"], "b": ["3"], "c": ["4", "5"], "d": ["26", "4"], "e": [], "f": []}
    assert sets_of_scenes(scenes) == [["a", "c", "d"], ["b"], ["e"], ["f"]]
