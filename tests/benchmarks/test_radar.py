"""The radar's page: the residuals and the fit, of errors that are known, and what the committed page says."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import radar
from trackbench.models.sensors import Radar
from trackbench.models.sensors.effects import gauss_markov
from trackbench.models.sensors.presets import typical


def objects_of(errors):
    """An object of 12 s at 20 Hz for each column, which brakes evenly."""
    time = np.arange(len(errors)) * radar.PERIOD_S
    kept = (time % 10 < 9) | (np.arange(len(time)) % 3 == 0)
    motion = 50 + 3 * time - 0.5 * time**2
    return [
        radar.Segment(number, time[kept], np.tile((values + motion)[kept], (3, 1)))
        for number, values in enumerate(errors.T)
    ]


@pytest.fixture(scope="module")
def slow():
    """Sums of products of residuals: of slow errors of 0.2 s, with a share of 0.8, and a white rest."""
    time, random = np.arange(240) * radar.PERIOD_S, np.random.default_rng(1)
    errors = gauss_markov(time, 0.2, random.standard_normal((240, 120)), order=2)
    return radar.lagged(objects_of(np.sqrt(0.8) * errors + np.sqrt(0.2) * random.standard_normal(errors.shape)))


def test_the_share_and_the_time_of_slow_errors_are_found(slow):
    for found, true in zip(radar.fitted(slow["all"]), (0.8, 0.2), strict=True):
        low, high = np.quantile(found[1:], [0.005, 0.995])
        assert low < true < high
        assert high - low < 0.35 * true


def test_the_committed_page_is_of_the_typical_figures_and_passes_far_away_on_the_half_that_is_held_back():
    page = (Path(radar.__file__).parents[1] / "results" / "radar" / "radar.md").read_text(encoding="utf-8")
    (used,) = (of for of in typical("radar", Radar.components) if of["type"] == "correlated_errors")
    assert f"| typical | {used['share']:g} | {used['time_s']:g} |" in page
    rows = re.findall(r"(?m)^\| .* \| 100 to 185 m \| .* \| ([-+.\d]+) \| [-+.\d]+ \|$", page)
    assert len(rows) == 3
    assert all(abs(float(errors)) <= 2 for errors in rows)
