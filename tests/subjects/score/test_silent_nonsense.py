"""Files that contradict themselves or the truth: degrees, turned frames, other recordings, unknown observers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.report.sentences import external_tracks


def cars(seconds: float = 20) -> pd.DataFrame:
    """Six cars on a road that bends, with their velocities."""
    time, parts = np.arange(0, seconds, 0.1), []
    for car in range(6):
        angle, radius = (8 + car) * time / 150, 150 + 4.0 * car
        x, y = radius * np.sin(angle) + 20, radius * (1 - np.cos(angle)) - 60
        speed = radius * (8 + car) / 150
        rows = {"time": time, "id": car, "x": x, "y": y, "vx": speed * np.cos(angle), "vy": speed * np.sin(angle)}
        parts.append(pd.DataFrame(rows))
    return pd.concat(parts, ignore_index=True)


def scored(folder: Path, tracks: pd.DataFrame, truth: pd.DataFrame | None = None, **options: Any) -> tb.Result:
    (cars() if truth is None else truth).to_csv(folder / "boxes.csv", index=False)
    tracks.to_csv(folder / "tracks.csv", index=False)
    return tb.score(folder / "tracks.csv", folder / "boxes.csv", **options)


def noisy(rows: pd.DataFrame, seed: int, sigma: float = 0.5) -> pd.DataFrame:
    random = np.random.default_rng(seed)
    return rows.assign(
        x=rows.x + random.normal(0, sigma, len(rows)),
        y=rows.y + random.normal(0, sigma, len(rows)),
        vx=rows.vx + random.normal(0, 1, len(rows)),
        vy=rows.vy + random.normal(0, 1, len(rows)),
    )


def remarks(result: tb.Result) -> tuple[str, ...]:
    filed = result["tracks"].filed
    assert filed is not None
    return filed.remarks


@pytest.mark.parametrize(
    ("x", "y", "words"),
    [
        ("y", "x", "x and y exchanged"),
        ("-y", "x", "turned by -90"),
        ("y", "-x", "turned by 90"),
        ("-x", "-y", "turned by 180"),
        ("x", "-y", "y = -y"),
    ],
)
def test_another_frame_is_named(tmp_path: Path, x: str, y: str, words: str) -> None:
    rows = noisy(cars(), 1).drop(columns=["vx", "vy"])
    turned = rows.assign(x=rows.eval(x), y=rows.eval(y))
    (remark,) = remarks(scored(tmp_path, turned))
    assert words in remark
    assert "100 % would be" in remark


def test_tracks_of_another_recording_are_questioned(tmp_path: Path) -> None:
    rows = cars().drop(columns=["vx", "vy"])
    result = scored(tmp_path, rows.assign(x=rows.x + 400))
    (remark,) = remarks(result)
    assert remark.startswith("0.0 % of its rows are within 5 m of an object")
    assert any(remark in sentence for sentence in external_tracks(result))


def test_a_tracker_of_one_car_of_six_with_false_tracks_is_in_its_frame(tmp_path: Path) -> None:
    rows = cars()
    false = pd.DataFrame({"time": rows.time[:200], "id": 100, "x": 0.0, "y": 300.0, "vx": 0.0, "vy": 0.0})
    result = scored(tmp_path, pd.concat([noisy(rows[rows.id == 3], 2), false]))
    assert result["tracks"].matched_share.value < 0.2
    assert remarks(result) == ()


def test_tracks_of_other_traffic_are_of_this_recording(tmp_path: Path) -> None:
    """One car has a truth; eleven others are far from it."""
    truth = cars()[:200]
    others = [noisy(truth.assign(id=100 + car, y=truth.y + 20.0 * (car + 1)), car) for car in range(11)]
    result = scored(tmp_path, pd.concat([noisy(truth, 9), *others]), truth)
    assert result["tracks"].matched_share.value > 0.9
    assert remarks(result) == ()


def degrees(rows: pd.DataFrame, east: float = 0.0) -> pd.DataFrame:
    """The rows about 48.1 N, 11.6 E, by the radii of curvature there."""
    phi, squared = np.radians(48.1), 0.00669437999014
    curved = 1 - squared * np.sin(phi) ** 2
    north_radius, east_radius = 6378137 * (1 - squared) / curved**1.5, 6378137 / curved**0.5
    return pd.DataFrame(
        {
            "time": rows.time,
            "id": rows.id,
            "latitude": 48.1 + np.degrees(rows.y / north_radius),
            "lon": 11.6 + np.degrees((rows.x + east) / (east_radius * np.cos(phi))),
            "speed": np.hypot(rows.vx, rows.vy),
        }
    )


def test_degrees_are_refused(tmp_path: Path) -> None:
    for x, y in (("lon", "latitude"), ("latitude", "lon")):
        with pytest.raises(InputError, match=r"is in degrees, and metres are scored: project it first"):
            scored(tmp_path, degrees(cars(), 3.0), degrees(cars()), columns={"x": x, "y": y})


KITTI = "{frame} {id} Car 0 0 0.0 100 100 200 200 1.5 1.7 4.2 0.0 1.6 {z:.2f} -1.5708{score}\n"


def test_a_range_counts_from_the_camera_of_kitti(tmp_path: Path) -> None:
    """Cars 10 and 60 m ahead of it; the middle of the boxes is 35 m ahead."""
    places = {"labels": {0: 10.0, 1: 60.0}, "near": {0: 10.0}, "far": {1: 60.0}}
    for name, cars_ahead in places.items():
        lines = [
            KITTI.format(frame=frame, id=car, z=z, score="" if name == "labels" else " 1")
            for frame in range(60)
            for car, z in cars_ahead.items()
        ]
        (tmp_path / f"{name}.txt").write_text("".join(lines))
    reference = {"truth.reference": {"range_m": 20}}
    tb.score([tmp_path / "near.txt", tmp_path / "far.txt"], tmp_path / "labels.txt", format="kitti", out=tmp_path)
    result = tb.run(tb.load(tmp_path / "labels.yaml", reference))
    assert result["near"].gospa.value == pytest.approx(0, abs=1e-9)
    assert result["near"].matched_share.value == 1
    assert result["far"].matched_share.value == 0


def test_a_range_needs_an_observer_where_the_format_has_none(tmp_path: Path) -> None:
    cars().to_csv(tmp_path / "boxes.csv", index=False)
    tb.score(tmp_path / "boxes.csv", tmp_path / "boxes.csv", out=tmp_path)
    reference = {"truth.reference": {"range_m": 50}}
    with pytest.raises(InputError, match=r"truth\.reference\.range_m.*observer: \{x: 0, y: 0\}"):
        tb.load(tmp_path / "boxes.yaml", reference)
    result = tb.run(tb.load(tmp_path / "boxes.yaml", {**reference, "truth.observer": {"x": 20, "y": -60}}))
    assert result["boxes"].matched_share.value == 1
