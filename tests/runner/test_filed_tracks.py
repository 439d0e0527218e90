"""Tracks that another program wrote: bit for bit those of a built-in tracker, at their own time stamps, and silence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.runner.filed_tracks import offset_of

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


@pytest.mark.parametrize("offset", [0.05, -0.02])
def test_a_constant_offset_is_shown_and_taken_out_only_when_it_is_asked(tmp_path: Path, offset: float) -> None:
    rows = exact(np.arange(0.5, 9, 0.05))
    rows["x"] += np.random.default_rng(1).normal(0, 0.1, len(rows))
    late = rows.assign(time=rows.time + offset)
    shown = scored(tmp_path, late)["theirs"].time_offset
    low, high = shown.ci95
    assert low < shown.value < high < low + 2e-3
    assert shown.value == pytest.approx(-offset, abs=5e-4)
    assert scored(tmp_path, late)["theirs"].siap_position.value > 0.3
    moved = scored(tmp_path, late, f"trackers.theirs.time_offset_s={-offset}")["theirs"]
    assert moved.siap_position.value < 0.15
    assert abs(moved.time_offset.value) < 1e-3


def test_the_interval_of_an_offset_covers_it() -> None:
    random, covered = np.random.default_rng(3), 0
    velocity = 20 + random.normal(0, 2, 60)
    for _ in range(400):
        error = 0.05 * velocity + random.normal(0, 0.5, 60)
        sums = np.stack([(error * velocity).reshape(10, 6).sum(axis=1), (velocity**2).reshape(10, 6).sum(axis=1)])
        low, high = offset_of(sums).ci95
        covered += low < 0.05 < high
    # 380 are expected, and 360 to 397 in all but one of a thousand cases.
    assert 360 <= covered <= 397


def test_what_tracks_do_not_state_is_not_available(tmp_path: Path) -> None:
    result = scored(tmp_path, exact(np.arange(0, 10, 0.05)))["theirs"]
    for path in ("nees", "velocity_rmse", "siap_velocity", "step_time", "association_right"):
        assert result.metrics[path].value is None
        assert result.metrics[path].reason


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("monte_carlo.runs=2", "there is no column run"),
        ("sensing.identities=known", "write sensing: {identities: hidden}"),
        ("trackers.theirs.path=none.csv", "there is no file none.csv"),
        ("trackers.theirs.path=tracks.txt", "motchallenge end in it"),
        ("trackers.theirs.format=cvs", "csv"),
    ],
)
def test_mistakes_are_one_line(tmp_path: Path, override: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        scored(tmp_path, exact(np.arange(0, 10, 0.05)), override)
    assert "\n" not in str(raised.value)
