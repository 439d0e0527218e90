"""Formats of recorded traffic: what each reads, its rows, and what is said of a wrong table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.traffic_files import CARS, OPTIONS, TIME, WRITERS, write_commonroad, write_csv

from trackbench.base.errors import InputError
from trackbench.truth.formats.tables import I80_FILE
from trackbench.truth.tracks import TRAFFIC_FORMATS, TrackRows, TrafficTrack, moving_tracks, tracks_of_rows


def read(name: str, file: Path) -> list[TrafficTrack]:
    return moving_tracks(TRAFFIC_FORMATS[name](**OPTIONS.get(name, {})).read(file), file)[0]


def written(name: str, folder: Path) -> Path:
    package = {"mcap": "mcap", "ros": "rosbags"}.get(name)
    if package is not None:
        pytest.importorskip(package, reason=f"needs trackbench[{name}]")
    return WRITERS[name](folder)


def name_of(id: str) -> str:
    """As ``CARS`` has it; objects of ROS have 16 bytes."""
    return str(int(bytes.fromhex(id))) if len(id) == 32 else id


@pytest.mark.parametrize("name", sorted(WRITERS))
def test_a_file_gives_its_tracks(name: str, tmp_path: Path) -> None:
    tracks = {name_of(track.id): track for track in read(name, written(name, tmp_path))}
    assert set(tracks) == set(CARS)
    for car, (x, y, heading, speed, length, width) in CARS.items():
        track = tracks[car]
        if name == "highd":
            x, y = x[0] + speed * TIME, y[0] + 0 * y
        np.testing.assert_allclose(track.time, TIME, atol=1e-9)
        np.testing.assert_allclose(track.x, x, atol=1e-9)
        np.testing.assert_allclose(track.y, y, atol=1e-9)
        if name == "motchallenge":
            assert (track.speed, track.heading, track.length) == (None, None, None)
            continue
        if name != "kitti":
            assert track.speed is not None
            np.testing.assert_allclose(track.speed, speed, atol=1e-9)
        if name != "highd":
            assert track.heading is not None
            np.testing.assert_allclose(track.heading, heading, atol=1e-9)
        assert (track.length, track.width) == (length, width)
        assert track.kind in ("car", "truck")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("id,class,time,x", "id,class,time,ex", "there is no column 'x'; "),
        ("1,car,0.1,", "1,car,0.0,", "1 has two rows at 0 s"),
        ("1,car,0.1,1.0", "1,car,0.1,nan", "x is not a finite number: 'nan'"),
        ("1,car,0.1,1.0", "1,car,0.1,1e12", "check its unit"),
        ("1,car,0.1,1.0", "1,car,1e6,1.0", "check the unit of time"),
        (",4.5,1.8\n", ",450,1.8\n", ".csv:2: length is '450': it would be 450 m, and 0.001 to 100 m can be meant"),
        (",4.5,1.8\n", ",-3,1.8\n", ".csv:2: length is '-3': it would be -3 m, and 0.001 to 100 m can be meant"),
        (",4.5,1.8\n", ",4.5,0\n", ".csv:2: width is '0': it would be 0 m, and 0.001 to 100 m can be meant"),
    ],
)
def test_what_is_wrong_with_a_table(old: str, new: str, message: str, tmp_path: Path) -> None:
    file = write_csv(tmp_path)
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read("csv", file)
    assert message in str(caught.value)


def test_rows_may_stand_in_any_order(tmp_path: Path) -> None:
    file = write_csv(tmp_path)
    first = read("csv", file)
    head, *lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join([head, *reversed(lines)]), encoding="utf-8")
    again = {track.id: track for track in read("csv", file)}
    for track in first:
        np.testing.assert_array_equal(again[track.id].x, track.x)


def test_columns_may_have_other_names_and_units(tmp_path: Path) -> None:
    file = write_csv(tmp_path)
    text = file.read_text(encoding="utf-8").replace("id,class,time,x", "id,class,t,x", 1)
    file.write_text(text, encoding="utf-8")
    form = TRAFFIC_FORMATS["csv"].model_validate({"columns": {"time": "t", "x": "x:cm", "length": "length:cm"}})
    track = form.read(file)[0]
    np.testing.assert_allclose(track.x, CARS["1"][0] / 100)
    assert track.length == pytest.approx(0.045)


@pytest.mark.parametrize("key", ["<orientation><exact>", "<velocity><exact>", "<length>", "<x>"])
def test_a_long_text_in_place_of_a_number_is_one_short_line_with_the_obstacle(key: str, tmp_path: Path) -> None:
    file = write_commonroad(tmp_path)
    file.write_text(file.read_text(encoding="utf-8").replace(key, key + "x" * 5000, 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"obstacle '1': 'x{20}' is not a finite number"):
        read("commonroad", file)


def test_without_the_package_mcap_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "cars.mcap"
    file.write_bytes(b"\x89MCAP0\r\n")
    monkeypatch.setitem(__import__("sys").modules, "mcap.reader", None)
    with pytest.raises(InputError, match=r"pip install 'trackbench\[mcap\]'"):
        read("mcap", file)


def test_the_shipped_recording_is_that_of_the_history() -> None:
    """As the file of SMARTS has it, but for the rounding to mm, mm/s and 1e-4 rad."""
    tracks = read("i80", I80_FILE)
    assert len(tracks) == 200
    assert {len(track.time) for track in tracks} == {101}
    assert I80_FILE.stat().st_size <= 400_000
    assert I80_FILE.with_name("i80.txt").is_file()


def test_the_shipped_recording_is_made_of_the_history(recorded_traffic: Path) -> None:
    shipped = {track.id: track for track in read("i80", I80_FILE)}
    for track in read("smarts", recorded_traffic / "i80.shf"):
        own = shipped[track.id]
        for key, most in {"time": 1e-6, "x": 5.01e-4, "y": 5.01e-4, "speed": 5.01e-4, "heading": 5.01e-5}.items():
            np.testing.assert_allclose(getattr(own, key), getattr(track, key), atol=most, rtol=0)
        assert own.length == pytest.approx(track.length, abs=5.01e-4)


def test_recorded_files_are_read(recorded_traffic: Path) -> None:
    us101 = read("commonroad", recorded_traffic / "USA_US101-5_1_T-1.xml")
    assert len(us101) == 25
    trace = read("osi", recorded_traffic / "example_sv_trace.osi")
    assert [len(track.time) for track in trace] == [547, 547]
    assert all(track.length and track.width for track in trace)


STAMPS = np.array([0.2, 0.0, 0.1])


def test_a_body_without_a_heading_has_none_and_half_a_heading_is_refused() -> None:
    heading = np.array([0.2, 0.3, np.nan])
    rows = TrackRows(["a", "a", "b"], STAMPS, STAMPS, STAMPS, heading=heading, length=np.array([4.0, 4.0, np.nan]))
    first, second = tracks_of_rows(rows, Path("a.csv"))
    assert (first.length, second.length, second.heading) == (4.0, None, None)
    np.testing.assert_array_equal(first.heading, [0.3, 0.2])
    with pytest.raises(InputError, match=r"heading is not a finite number at 0\.1 s"):
        tracks_of_rows(replace(rows, id=["a", "a", "a"]), Path("a.csv"))


def test_ordered_rows_keep_their_columns_together() -> None:
    covariance = np.arange(48.0).reshape(4, 4, 3)
    table = TrackRows(["x", "y", "z"], STAMPS, STAMPS + 1, STAMPS + 2, covariance=covariance, run=["0", "1", "0"])
    ordered = table.ordered(Path("a.csv"))
    assert list(ordered.id) == ["y", "z", "x"]
    assert list(ordered.run or ()) == ["1", "0", "0"]
    np.testing.assert_array_equal(ordered.px - ordered.time, 1.0)
    np.testing.assert_array_equal(ordered.covariance, covariance[..., [1, 2, 0]])


def test_one_id_at_one_time_is_one_row_of_a_run() -> None:
    twice = TrackRows(["x", "x"], np.zeros(2), np.zeros(2), np.ones(2), run=["0", "1"])
    assert len(twice.ordered(Path("a.csv"))) == 2
    with pytest.raises(InputError, match=r"a\.csv: x has two rows at 0 s"):
        TrackRows(["x", "x"], np.zeros(2), np.zeros(2), np.ones(2)).ordered(Path("a.csv"))
