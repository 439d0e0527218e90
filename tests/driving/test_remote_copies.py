"""Copies of a tracker in a process of its own."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path

import pytest

from trackbench.driving.isolation import ISOLATED
from trackbench.driving.program import ProgramTracker
from trackbench.driving.start import fresh
from trackbench.testing.drives import drive
from trackbench.trackers.config import PluginConfig

COUNTS = """\
import numpy as np


class Tracker:
    def __init__(self):
        self.steps = 0

    def step(self, state, scan):
        self.steps += 1
        if self.steps == 4:
            raise KeyError("four")
        return state, (np.full(4, float(self.steps)), np.eye(4))
"""
SCAN = next(iter(drive(["lidar"], [0.0])))


@pytest.fixture
def tracker(tmp_path: Path, write_module: Callable[[Path, str], str]) -> ProgramTracker:
    made = fresh(
        PluginConfig.model_validate({"use": f"{write_module(tmp_path, COUNTS)}:Tracker"}), tmp_path, ISOLATED
    )()
    assert isinstance(made, ProgramTracker)
    return made


def steps(tracker: ProgramTracker) -> float:
    mean, _ = tracker.step(None, SCAN)[1]
    return float(mean[0])


def test_a_copy_has_the_state_of_when_it_was_made(tracker: ProgramTracker) -> None:
    assert steps(tracker) == 1.0
    before = copy.deepcopy(tracker)
    assert (steps(tracker), steps(tracker)) == (2.0, 3.0)
    assert (steps(before), steps(before)) == (2.0, 3.0)


def test_a_copy_outlives_what_it_is_of(tracker: ProgramTracker) -> None:
    assert steps(tracker) == 1.0
    twin = copy.deepcopy(copy.deepcopy(tracker))
    assert steps(twin) == 2.0
