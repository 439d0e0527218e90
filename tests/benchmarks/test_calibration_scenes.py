"""Intervals and differences over scenes of real traffic, on the committed table of scenes, with few trials."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.calibration import scenes

from trackbench.metrics import contrasts

pytestmark = pytest.mark.slow
TRIALS = 400
#: Three times the Monte-Carlo error of a mean over trackers that are drawn together.
ERROR = 0.02


@pytest.mark.parametrize("environment", scenes.SCENES)
@pytest.mark.parametrize("size", scenes.SIZES)
def test_an_interval_over_scenes_covers_the_mean_of_all(environment: str, size: int) -> None:
    inside, widths = scenes.coverage(np.random.default_rng(2), environment, "position", size, TRIALS)
    assert 0.93 - ERROR <= inside.mean() <= 0.97 + ERROR
    assert size < max(scenes.SIZES) or widths.mean() <= scenes.WIDEST


def test_students_interval_does_not_cover(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the stretch is for."""
    rmse = scenes.rmse
    monkeypatch.setattr(scenes, "rmse", lambda *sums: rmse(*sums)._replace(scenes=False))
    inside, _ = scenes.coverage(np.random.default_rng(2), "highway", "position", 10, TRIALS)
    assert inside.mean() < 0.9


@pytest.mark.parametrize("metric", scenes.METRICS)
def test_no_tracker_is_often_called_better_than_its_equal(metric: str) -> None:
    """Nor is this for want of power: of pairs a tenth apart most are found."""
    equal, apart = scenes.better(np.random.default_rng(3), "highway", metric, 10, 2 * TRIALS)
    # Of 30 pairs the one that is called so most often, with its Monte-Carlo error.
    assert float(equal.measured.split()[0]) <= 3.5 + 1.0
    assert float(apart.measured.split()[0]) >= 60


def test_without_what_scenes_do_not_show_some_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contrasts, "_allowed", lambda *_: (0.0, 0.0))
    equal, _ = scenes.better(np.random.default_rng(3), "highway", "position", 10, TRIALS)
    assert float(equal.measured.split()[0]) > 7
