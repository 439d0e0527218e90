"""The table of what perception costs: its tests against closed forms, and the page against its numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import gym


def test_crashes_are_compared_by_the_exact_test() -> None:
    own, reference = np.array([1.0, 1, 1, 1, 1, 1, 0, 0]), np.array([0.0, 0, 0, 0, 0, 0, 0, 1])
    # Six against one of seven that differ: (1 + 7) / 2^7 on one side.
    assert gym.compared(own, reference) == "6 more, 1 fewer (p = 0.12)"
    assert gym.compared(np.ones(6), np.zeros(6)) == "**6 more, 0 fewer (p = 0.031)**"
    assert gym.compared(own, own) == "0 more, 0 fewer (p = 1)"


def test_the_mean_of_the_differences_is_paired() -> None:
    random = np.random.default_rng(1)
    traffic = random.standard_normal(40)
    difference = gym.paired(gym.mean(traffic - 0.5 + 0.01 * random.standard_normal(40)), gym.mean(traffic))
    assert difference.value == pytest.approx(-0.5, abs=0.01)
    assert difference.ci95 is not None
    assert difference.ci95[1] - difference.ci95[0] < 0.02
    assert gym.shown(difference, 1).startswith("**-0.5 (")


def test_the_committed_page_is_that_of_the_committed_episodes() -> None:
    episodes = json.loads((gym.OUT / "episodes.json").read_text(encoding="utf-8"))
    assert {len(of) for of in episodes.values()} == {gym.EPISODES}
    assert list(episodes) == list(gym.ARMS)
    assert (gym.OUT / "README.md").read_text(encoding="utf-8") == gym.page(episodes)
