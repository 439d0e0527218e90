"""Boxes as tracks of themselves are right at every instant: with noise, at whatever times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import trackbench as tb


def perfect(result: tb.Result, name: str) -> None:
    metrics = result[name].metrics
    found = {path: metrics[path].value for path in ("tgospa", "gospa", "hota", "mota", "matched_share")}
    assert found == pytest.approx({"tgospa": 0, "gospa": 0, "hota": 1, "mota": 1, "matched_share": 1}, abs=1e-6)


def boxes(times: np.ndarray, cars: int = 3) -> pd.DataFrame:
    """Cars side by side at 10 m/s and more, at the same times."""
    parts = [pd.DataFrame({"t": times, "id": car, "x": (10 + car) * times, "y": 4.0 * car}) for car in range(cars)]
    return pd.concat(parts, ignore_index=True)


def noisy(random: np.random.Generator) -> pd.DataFrame:
    rows = boxes(np.arange(200) / 10)
    rows[["x", "y"]] += random.normal(0, 0.3, (len(rows), 2))
    return rows


def jittered(random: np.random.Generator) -> pd.DataFrame:
    return boxes(np.arange(200) / 10 + random.uniform(-0.02, 0.02, 200))


def with_gaps(random: np.random.Generator) -> pd.DataFrame:
    """Frames that are lost, and a car that is away for some seconds and comes back."""
    rows = boxes(np.arange(200) / 10.02)
    rows = rows[~rows.t.isin(random.choice(rows.t.unique(), 20, replace=False))]
    return rows[~((rows.id == 1) & rows.t.between(6, 10))]


def each_at_its_own_times(random: np.random.Generator) -> pd.DataFrame:
    """No two cars at one time, and each there for another while."""
    rows = boxes(np.arange(200) / 10)
    rows["t"] += rows.id.map({0: 0.0, 1: 0.031, 2: 0.067})
    rows["x"] += (10 + rows.id) * rows.id.map({0: 0.0, 1: 0.031, 2: 0.067})
    return rows[~((rows.id == 1) & ~rows.t.between(3, 9)) & ~((rows.id == 2) & rows.t.between(5, 8))]


def single(random: np.random.Generator) -> pd.DataFrame:
    """Cars of one box or two among others."""
    rows = boxes(np.arange(100) / 10)
    return rows[(rows.id == 0) | ((rows.id == 1) & (rows.t == 4.2)) | ((rows.id == 2) & rows.t.isin([5.0, 5.1]))]


def of_years(random: np.random.Generator) -> pd.DataFrame:
    """Nanoseconds since 1970 on a map."""
    rows = noisy(random).rename(columns={"t": "timestamp_ns"})
    rows["timestamp_ns"] = (rows.timestamp_ns * 1e9).round().astype(np.int64) + 1_700_000_000_123_456_789
    return rows.assign(x=rows.x + 691_000, y=rows.y + 5_300_000)


@pytest.mark.parametrize("made", [noisy, jittered, with_gaps, each_at_its_own_times, single, of_years])
def test_boxes_that_are_hard(made: Callable[..., pd.DataFrame], tmp_path: Path) -> None:
    made(np.random.default_rng(1)).to_csv(tmp_path / "boxes.csv", index=False)
    perfect(tb.score(tmp_path / "boxes.csv", tmp_path / "boxes.csv"), "boxes")


def score(folder: Path, truth: pd.DataFrame, **tracks: pd.DataFrame) -> dict[str, dict[str, float]]:
    """The values of the metrics, by file of tracks."""
    truth.to_csv(folder / "truth.csv", index=False)
    for name, rows in tracks.items():
        rows.to_csv(folder / f"{name}.csv", index=False)
    result = tb.score([folder / f"{name}.csv" for name in tracks], folder / "truth.csv")
    return {name: {path: item.value for path, item in result[name].metrics.items()} for name in tracks}


def test_an_id_that_comes_back_is_the_same_object(tmp_path: Path) -> None:
    truth = boxes(np.arange(300) / 10)
    truth = truth[~((truth.id == 1) & truth.t.between(10, 14))]
    kept = truth.copy()
    changed = truth.assign(id=np.where((truth.id == 1) & (truth.t > 12), 9, truth.id))
    found = score(tmp_path, truth, kept=kept, changed=changed)
    assert found["kept"]["hota"] == pytest.approx(1)
    # Association by closed form: two cars whole, of 300 rows each, and one in parts of 100 and 159.
    assert found["changed"]["hota"] == pytest.approx(np.sqrt((600 + (100**2 + 159**2) / 259) / 859), abs=1e-9)
    assert found["kept"]["id_switches"] == 0 < found["changed"]["id_switches"]


def test_rows_that_are_missing_are_not_filled_in(tmp_path: Path) -> None:
    truth, random = boxes(np.arange(300) / 10), np.random.default_rng(2)
    two = truth[truth.t.isin([0.5, 15.5])]
    some = truth[random.random(len(truth)) < 0.3]
    found = score(tmp_path, truth, two=two, some=some)
    # A row holds for a quarter of a second before and after it, or for its own instant.
    assert found["two"]["matched_share"] <= 5 * 2 / 300 + 1e-9
    assert found["some"]["matched_share"] == pytest.approx(len(some) / len(truth), abs=1e-9)


def test_tracks_at_other_times_than_their_neighbours(tmp_path: Path) -> None:
    truth = boxes(np.arange(300) / 10)
    apart = truth.assign(t=truth.t + np.where(truth.id == 0, 0, 0.03))
    apart["x"] += np.where(truth.id == 0, 0, 0.03) * (10 + truth.id)
    # Two sensors take turns, each of which sees one of two cars.
    fast = boxes(np.arange(600) / 20, cars=2)
    turns = fast[(fast.t * 20).round() % 2 == fast.id]
    assert score(tmp_path, truth, apart=apart)["apart"]["matched_share"] == pytest.approx(1)
    assert score(tmp_path, fast, turns=turns)["turns"]["matched_share"] == pytest.approx(1, abs=2 / 600)


@pytest.mark.parametrize(("shift", "message"), [(1.7e9, "tracks begin 1.7e+09 s after"), (-60.0, "tracks end 30")])
def test_files_of_different_clocks_are_refused(
    shift: float, message: str, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    rows = boxes(np.arange(300) / 10)
    rows.to_csv(tmp_path / "truth.csv", index=False)
    rows.assign(t=rows.t + shift).to_csv(tmp_path / "tracks.csv", index=False)
    done = cli("score", "tracks.csv", "--truth", "truth.csv", "--gate", "gospa_false:0.5", "--no-recording")
    assert done.status == 2
    assert message in done.err.splitlines()[-1]


def test_rows_outside_the_time_of_the_truth_are_named(tmp_path: Path, cli: Callable[..., Any]) -> None:
    rows = boxes(np.arange(300) / 10)
    rows[rows.t < 20].to_csv(tmp_path / "truth.csv", index=False)
    rows.to_csv(tmp_path / "tracks.csv", index=False)
    done = cli("score", "tracks.csv", "--truth", "truth.csv", "--no-recording")
    # Up to a quarter of a second after the last box they may be of its instant.
    assert "tracks: 294 of 900 rows outside the time of the truth" in " ".join(done.out.split())


@pytest.mark.parametrize(("seconds", "stretches"), [(12, 0), (30, 7), (60, 10)])
def test_long_files_have_intervals_and_short_ones_say_why_not(
    seconds: int, stretches: int, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    truth, random = boxes(np.arange(10 * seconds + 1) / 10), np.random.default_rng(5)
    truth.to_csv(tmp_path / "truth.csv", index=False)
    for name, sigma in (("good", 0.1), ("bad", 1.0)):
        moved = truth[["x", "y"]] + random.normal(0, sigma, (len(truth), 2))
        truth.assign(x=moved.x, y=moved.y).to_csv(tmp_path / f"{name}.csv", index=False)
    done = cli("score", "good.csv", "bad.csv", "--truth", "truth.csv", "--no-recording")
    metric = tb.Result.load(tmp_path / "results" / "truth")["good"].gospa
    assert (metric.ci95 is not None) == (stretches > 0)
    assert (f"{stretches} stretches of one log" in done.out) == (stretches > 0)
    assert ("No intervals: a single run" in done.out) == (stretches == 0)
