"""Tracks that another program wrote: bit for bit those of a built-in tracker, at their own time stamps, and silence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.signal import lfilter

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.runner.external_run import offset_of

#: Two cars that go straight on at 20 m/s and 25 m/s, seen by nobody.
SCENE = """\
name: two_cars
truth:
  source: scripted
  duration_s: 10
  rate_hz: 20
  objects:
    slow: {start: {x: 0, y: 0, vx_mps: 20}}
    fast: {start: {x: -40, y: 8, vx_mps: 25}}
sensing: {identities: hidden}
monte_carlo: {runs: 1}
trackers:
  theirs: {use: tracks, path: tracks.csv}
"""
INSTANTS = np.arange(201) / 20


def exact(times: np.ndarray, cars: str = "slow fast") -> pd.DataFrame:
    """Rows without error at some times."""
    places = {"slow": (0.0, 20.0, 0.0), "fast": (-40.0, 25.0, 8.0)}
    rows = [
        {"time": t, "id": name, "x": places[name][0] + places[name][1] * t, "y": places[name][2]}
        for t in times
        for name in cars.split()
    ]
    return pd.DataFrame(rows)


def scored(folder: Path, rows: pd.DataFrame, *overrides: str) -> tb.Result:
    rows.to_csv(folder / "tracks.csv", index=False)
    (folder / "scene.yaml").write_text(SCENE)
    given = {key: yaml.safe_load(value) for key, value in (item.split("=") for item in overrides)}
    return tb.run(tb.load(folder / "scene.yaml", given))


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tracks_of_a_built_in_tracker_score_alike_to_the_last_bit(tmp_path: Path, ending: str) -> None:
    own = tb.run(tb.load("traffic/cut_in", {"truth.duration_s": 15}, runs=1, trackers=["jipda"]))
    rows = own.to_pandas("tracks").drop(columns="tracker")
    file = tmp_path / f"tracks.{ending}"
    rows.to_csv(file, index=False) if ending == "csv" else rows.to_parquet(file)
    entry = {"use": "tracks", "path": str(file)}
    both = tb.run(tb.load("traffic/cut_in", {"trackers.theirs": entry}, runs=1, trackers=["jipda", "theirs"]))
    theirs, ours = both["theirs"].metrics, own["jipda"].metrics
    kept = [path for path in ours if path != "step_time" and not path.startswith("association")]
    assert ours["gospa"].value > 0.1
    assert {path: theirs[path].value for path in kept} == {path: ours[path].value for path in kept}
    assert both["theirs"].offline
    assert not both["jipda"].offline


def test_the_truth_is_taken_at_the_stamps_of_the_tracks(tmp_path: Path) -> None:
    late = scored(tmp_path, exact(INSTANTS + 0.013))["theirs"]
    assert late.gospa.value == pytest.approx(0, abs=1e-9)
    # Each track of an instant at another time.
    apart = pd.concat([exact(INSTANTS + 0.013, "slow"), exact(INSTANTS + 0.02, "fast")])
    assert scored(tmp_path, apart)["theirs"].gospa.value == pytest.approx(0, abs=1e-9)
    # Half as often as the truth.
    assert scored(tmp_path, exact(INSTANTS[::2]))["theirs"].gospa.value == pytest.approx(0, abs=1e-9)


def test_an_instant_without_a_track_within_half_a_period_is_silence(tmp_path: Path) -> None:
    rows = exact(np.arange(0, 10, 0.05) + 0.01)
    result = scored(tmp_path, rows[(rows.time < 4) | (rows.time > 6) | (rows.id == "fast")])["theirs"]
    # Of 201 instants of two cars, those from 4 to 6 s are missed for one.
    assert result.matched_share.value == pytest.approx(1 - 40 / 402, abs=2 / 402)


def braking(times: np.ndarray, offset: float = 0.0, behind: float = 0.0, cars: int = 10) -> pd.DataFrame:
    """Cars whose speeds swing from 10 to 20 m/s: where they are, with stamps that are late, of a point behind."""
    parts = []
    for car in range(cars):
        x = 15 * times + 25 * np.sin(0.2 * times + car) - behind
        parts.append(pd.DataFrame({"time": times + offset, "id": car, "x": x, "y": 20.0 * car}))
    return pd.concat(parts)


def offset_shown(folder: Path, tracks: pd.DataFrame, **options: Any) -> tb.TrackerResult:
    braking(np.arange(300) / 10).to_csv(folder / "boxes.csv", index=False)
    tracks = tracks.assign(x=tracks.x + np.random.default_rng(1).normal(0, 0.1, len(tracks)))
    tracks.to_csv(folder / "tracks.csv", index=False)
    return tb.score(folder / "tracks.csv", folder / "boxes.csv", **options)["tracks"]


@pytest.mark.parametrize("offset", [0.05, -0.02, 0.3, 1.0])
def test_a_constant_offset_is_shown_and_taken_out_only_when_it_is_asked(tmp_path: Path, offset: float) -> None:
    late = braking(np.arange(20, 280) / 10, offset)
    shown = offset_shown(tmp_path, late)
    low, high = shown.time_offset.ci95
    assert low < -offset < high < low + 5e-3
    assert shown.offset_shown
    moved = offset_shown(tmp_path, late, time_offset_s=-offset)
    assert moved.position_rmse.value < 0.2
    assert moved.matched_share.value == pytest.approx(260 / 300)
    assert not moved.offset_shown


def test_nothing_is_said_of_an_offset_that_cannot_be_told(tmp_path: Path) -> None:
    steady = scored(tmp_path, exact(INSTANTS + 0.05).assign(time=np.repeat(INSTANTS, 2)))["theirs"]
    assert steady.time_offset.value is None
    assert "too alike" in steady.time_offset.reason
    assert not scored(tmp_path, exact(INSTANTS))["theirs"].offset_shown


@pytest.mark.slow
@pytest.mark.parametrize(("cars", "bias"), [(6, 0.0), (6, 0.3), (12, 0.3)])
def test_the_interval_of_an_offset_covers_it(cars: int, bias: float) -> None:
    """Errors that stay alike for half a second, and a constant one of each car."""
    random, time, covered = np.random.default_rng(3), np.arange(300) / 10, 0
    for _ in range(100):
        parts = []
        for car in range(cars):
            speed = random.uniform(8, 30) + 3 * np.sin(0.4 * time + random.uniform(0, 6))
            error = lfilter([0.3 * np.sqrt(1 - 0.8**2)], [1, -0.8], random.normal(size=len(time) + 50))[50:]
            y = error + bias * random.normal() + 0.05 * speed - 1.0
            parts.append(np.stack([0 * time, time, 0 * time + car, y, speed]))
        low, high = offset_of(np.concatenate(parts, axis=1)).time.ci95
        covered += low < 0.05 < high
    # 95 are expected; 86 or more in all but one of a thousand cases of a true 95 %.
    assert covered >= 86


def test_what_tracks_do_not_state_is_not_available(tmp_path: Path) -> None:
    result = scored(tmp_path, exact(np.arange(0, 10, 0.05)))["theirs"]
    for path in ("nees", "velocity_rmse", "step_time", "association_right"):
        assert result.metrics[path].value is None
        assert result.metrics[path].reason


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("monte_carlo.runs=2", "there is no column run"),
        ("sensing.identities=known", "write sensing: {identities: hidden}"),
        ("trackers.theirs.path=none.csv", "there is no file .*none.csv"),
        ("trackers.theirs.path=tracks.txt", "name it in format, such as kitti or motchallenge"),
        ("trackers.theirs.format=cvs", "csv"),
    ],
)
def test_mistakes_are_one_line(tmp_path: Path, override: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        scored(tmp_path, exact(np.arange(0, 10, 0.05)), override)
    assert "\n" not in str(raised.value)
