"""Perfect tracks whose time stamps jitter are perfect, and rows that are missing are silence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import trackbench as tb

SECONDS = 60.0
#: One row in so many is missing.
MISSING = 5


def on_path(time: np.ndarray) -> pd.DataFrame:
    """Return rows of a car that weaves and changes its speed, exactly where it is at its stamps."""
    return pd.DataFrame({"time": time, "id": 1, "x": 10 * time + 3 * np.sin(time), "y": 2 * np.sin(time / 2)})


def stamps(random: np.random.Generator, rate: float, jitter: float, *, missing: bool = False) -> np.ndarray:
    """Return stamps of frames at a rate, each off by up to a share of the period, every fifth perhaps missing."""
    frame = np.arange(1, SECONDS * rate)
    time = (frame + random.uniform(-jitter, jitter, len(frame))) / rate
    return time[frame % MISSING > 0] if missing else time


def scored(folder: Path, truth_rate: float = 50, **tracks: np.ndarray) -> tb.Result:
    on_path(np.arange(0, 60, 1 / truth_rate)).to_csv(folder / "boxes.csv", index=False)
    for name, time in tracks.items():
        on_path(time).to_csv(folder / f"{name}.csv", index=False)
    return tb.score([folder / f"{name}.csv" for name in tracks], folder / "boxes.csv")


def test_tracks_that_jitter_match_as_regular_ones_do(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    times = {f"by_{int(100 * jitter)}": stamps(random, 10, jitter) for jitter in (0.0, 0.1, 0.2, 0.25)}
    times["normal"] = times["by_0"] + random.normal(0, 0.01, len(times["by_0"]))
    result = scored(tmp_path, **times)
    for name in times:
        # The first tenth of a second has no track.
        assert result[name].matched_share.value > 0.994, name
        assert result[name].hota.value > 0.994, name
        assert result[name].position_rmse.value < 1e-3, name


def test_a_perfect_tracker_that_jitters_is_better_than_one_that_is_a_metre_off(tmp_path: Path) -> None:
    time = np.arange(0.1, 59.85, 0.1)
    rows = on_path(time)
    rows.assign(x=rows.x + 1).to_csv(tmp_path / "off.csv", index=False)
    on_path(time + np.random.default_rng(2).normal(0, 0.01, len(time))).to_csv(tmp_path / "jitters.csv", index=False)
    on_path(np.arange(0, 60, 0.02)).to_csv(tmp_path / "boxes.csv", index=False)
    result = tb.score([tmp_path / "jitters.csv", tmp_path / "off.csv"], tmp_path / "boxes.csv")
    assert result["jitters"].tgospa.value < 0.3 < 1 < result["off"].tgospa.value


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_missing_rows_and_a_second_of_silence_are_seen(tmp_path: Path, jitter: float) -> None:
    time = stamps(np.random.default_rng(3), 10, jitter, missing=True)
    away = time[(time < 20) | (time > 21)]
    result = scored(tmp_path, missing=time, away=away)
    # Of five periods one is out of reach of a row; the second of silence had eight rows.
    assert result["missing"].matched_share.value == pytest.approx(0.8, abs=0.012)
    lost = result["missing"].matched_share.value - result["away"].matched_share.value
    assert lost == pytest.approx(0.8 / 60, abs=0.004)
