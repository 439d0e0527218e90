"""Tables of a result over several scenes: each says of which scene its rows are, and truth and tracks have all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import trackbench as tb
from trackbench.results import Result

NUMBERS = ["time_s", "track", "px_m", "py_m"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three sequences of different lengths, and the tracks of two trackers."""
    place, rng = tmp_path_factory.mktemp("scenes"), np.random.default_rng(0)
    for name in ("boxes", "a", "b"):
        (place / name).mkdir()
    for k in range(3):
        time = np.arange(0, 2 + k, 0.1)
        rows = pd.DataFrame({"time": np.tile(time, 2), "id": np.repeat([1, 2], len(time))})
        rows = rows.assign(x=10 * rows.time + k, y=8.0 * rows.id)
        rows.to_csv(place / "boxes" / f"s{k}.csv", index=False)
        for name in ("a", "b"):
            rows.assign(x=rows.x + rng.normal(0, 0.3, len(rows))).to_csv(place / name / f"s{k}.csv", index=False)
    return place


@pytest.fixture(scope="module")
def several(folder: Path) -> Result:
    return tb.score([folder / "a", folder / "b"], folder / "boxes")


def test_the_tracks_of_every_scene_are_those_of_the_scene_alone(folder: Path, several: Result, tmp_path: Path) -> None:
    several.save(tmp_path / "kept")
    for result in (several, Result.load(tmp_path / "kept")):
        tracks, truth = result.to_pandas("tracks"), result.to_pandas("truth")
        assert tracks.scene.tolist() == sorted(tracks.scene)
        for k in range(3):
            alone = tb.score([folder / name / f"s{k}.csv" for name in "ab"], folder / "boxes" / f"s{k}.csv")
            own = tracks[tracks.scene == k]
            for tracker, other in zip("ab", alone.summary.trackers, strict=True):
                theirs = alone.to_pandas("tracks").query(f"tracker == '{other.name}'")
                pd.testing.assert_frame_equal(
                    own[own.tracker == tracker][NUMBERS].reset_index(drop=True), theirs[NUMBERS].reset_index(drop=True)
                )
            theirs = alone.to_pandas("truth")
            assert "scene" not in theirs
            np.testing.assert_array_equal(truth[truth.scene == k].px_m, theirs.px_m)


def test_a_table_of_the_recorded_scene_says_which_it_is(folder: Path, several: Result) -> None:
    """Also where another scene than the first is recorded."""
    text = """
name: second
truth: {source: recorded-boxes, format: csv, path: [boxes/s0.csv, boxes/s1.csv]}
sensing: {identities: hidden}
trackers: {a: {use: tracks, path: [a/s0.csv, a/s1.csv]}}
monte_carlo: {runs: 1}
recording: {scene: 1}
"""
    (folder / "second.yaml").write_text(text)
    for result, scene in ((several, 0), (tb.run(folder / "second.yaml"), 1)):
        assert result.summary.recorded_scene == scene
        for name in ("due", "objects"):
            assert set(result.to_pandas(name).scene) == {scene}
        every = (each.to_pandas("tracks").query("tracker == 'a' and scene < 2") for each in (several, result))
        first, own = (tracks[[*NUMBERS, "scene"]].reset_index(drop=True) for tracks in every)
        pd.testing.assert_frame_equal(own, first)


def test_with_known_identities_the_truth_has_every_scene() -> None:
    overrides = {"truth.duration_s": 2, "truth.seeds": 2, "monte_carlo.runs": 1, "expect": []}
    result = tb.run(tb.load("highway", overrides, trackers=["kf_cv"]))
    truth, estimates = result.to_pandas("truth"), result.to_pandas("estimates")
    assert set(truth.scene) == {0, 1}
    assert set(estimates.scene) == {0}
    assert [len(scene.objects) for scene in result.summary.truth.scenes] == [
        truth[(truth.scene == k) & (truth.role == "target")].object.nunique() for k in (0, 1)
    ]
