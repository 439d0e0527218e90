"""Intervals and differences over scenes of real traffic, on the committed table of scenes, with few trials."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.calibration import scenes

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


@pytest.mark.parametrize("tracker", ["imm_cv_ca", "imm_three"])
def test_an_imm_is_rarely_called_better_than_its_equal(tracker: str) -> None:
    wrong = scenes.falsely_better(
        np.random.default_rng(3), "highway", f"{tracker} position", "ekf_cv position", 10, 4 * TRIALS
    )
    assert np.mean(wrong) <= 0.035


def test_every_environment_has_its_scenes() -> None:
    for environment, number in scenes.SCENES.items():
        assert scenes.pool(environment)["count"].shape == (number, scenes.RUNS)
