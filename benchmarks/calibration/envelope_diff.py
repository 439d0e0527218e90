"""Two maps held against each other: a cell that is lost"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import trackbench as tb
from trackbench.base.execution import executor
from trackbench.subjects.envelope.api import envelope_of
from trackbench.subjects.envelope.claim import Envelope
from trackbench.subjects.envelope.diff import diff
from trackbench.subjects.envelope.mapping import EnvelopeMap
from trackbench.subjects.envelope.task import task_of

from .claim import Claim, power, rate

REPEATS = 200


def scenario(acceleration: float) -> dict[str, Any]:
    """All cells but the first are near the border, where other noise is most likely to decide them otherwise."""
    return {
        "name": "straight",
        "truth": {
            "source": "scripted",
            "duration_s": 3,
            "rate_hz": 10,
            "objects": {"car": {"start": {"x": 20, "y": 5, "speed_mps": 10}}},
        },
        "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.3}},
        "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": acceleration}},
        "expect": [{"tracker": "kf", "metric": "position_rmse", "below": 0.25}],
        "envelope": {
            "cells": 8,
            "runs": {"first": 25, "most": 100},
            "axes": {
                "sigma": {
                    "key": "sensors.lidar.position_sigma_m",
                    "values": [0.3, 0.36, 0.37, 0.38, 0.39, 0.4, 0.41, 0.42],
                }
            },
        },
    }


def made(acceleration: float, seed: int) -> Envelope:
    """A map with a seed of its own."""
    with executor(1) as chosen:
        envelope = EnvelopeMap(task_of(tb.load(scenario(acceleration), seed=seed)), chosen)
        envelope.make()
    return envelope_of(envelope, "")


def claims() -> Iterator[Claim]:
    """How often the same map with other noise is taken for a worse one, and how often a worse one is found."""
    maps = [made(1.0, seed) for seed in range(REPEATS + 1)]
    again = [not diff(before, after).passed for before, after in pairwise(maps)]
    yield rate("a map against itself with other seeds loses a cell", again, 0, 0.05)
    # The first cell is lost with 12 times the process noise.
    worse = [made(12.0, seed) for seed in range(REPEATS // 10)]
    for what, pairs in (("same", zip(maps, worse, strict=False)), ("other", zip(maps[1:], worse, strict=False))):
        lost = [not diff(before, after).passed for before, after in pairs]
        yield power(f"a tracker with 12 times the process noise loses a cell, {what} seeds", lost)
