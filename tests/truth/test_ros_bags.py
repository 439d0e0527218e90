"""Tracks in bags of ROS 2: what is read, at which time, and what is refused."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from tests.support.ros_bags import CAR, Messages, write_bag

from trackbench.base.errors import InputError
from trackbench.truth.config.logs import BAG
from trackbench.truth.formats.ros import RosBag

pytest.importorskip("rosbags", reason="needs trackbench[ros]")
IDS = {"odometry": "car", "markers": "cars/7", "detections": "a7", "tracked": bytes(range(16)).hex()}
X, Y, HEADING, SPEED, LENGTH, WIDTH = CAR


@pytest.mark.parametrize("mcap", [False, True])
@pytest.mark.parametrize("kind", IDS)
def test_each_message_gives_its_tracks_at_the_stamp_of_its_header(kind: str, mcap: bool, tmp_path: Path) -> None:
    make = getattr(Messages(), kind)
    file = write_bag(tmp_path, [("/objects", make(time)) for time in (0.5, 1.0, 2.25)], mcap=mcap)
    rows = RosBag().rows(file)
    assert [*rows.id] == [IDS[kind]] * 3
    np.testing.assert_allclose(rows.time, [0.5, 1.0, 2.25], atol=1e-9)
    np.testing.assert_allclose(rows.px, X + SPEED * np.cos(HEADING) * rows.time)
    np.testing.assert_allclose(rows.py, Y + SPEED * np.sin(HEADING) * rows.time)
    assert rows.heading is not None
    np.testing.assert_allclose(rows.heading, HEADING)
    if kind in ("odometry", "tracked"):
        assert rows.vx is not None
        np.testing.assert_allclose(rows.vx, SPEED * np.cos(HEADING))
        assert rows.covariance is not None
        np.testing.assert_array_equal(rows.covariance[:2, :2, 0], np.diag([0.4, 0.2]))
        velocity = rows.covariance[2:, 2:, 0]
        along = np.array([np.cos(HEADING), np.sin(HEADING)])
        assert along @ velocity @ along == pytest.approx(0.5)
        assert np.isnan(rows.covariance[:2, 2:]).all()
    else:
        assert rows.vx is None
        assert rows.covariance is None
    if kind != "odometry":
        assert rows.length is not None
        assert rows.length.tolist() == [LENGTH] * 3
    assert (rows.existence is None) == (kind != "tracked")
    if kind != "odometry":
        (track,) = RosBag().read(file)
        assert (track.length, track.width) == (LENGTH, WIDTH)


def test_a_clock_since_1970_keeps_its_nanoseconds(tmp_path: Path) -> None:
    make = Messages().odometry
    rows = RosBag().rows(write_bag(tmp_path, [("/odom", make(1_700_000_000.25)), ("/odom", make(1_700_000_001.5))]))
    assert rows.start == Decimal(1_700_000_000)
    assert rows.time.tolist() == [0.25, 1.5]


def test_a_bag_without_definitions_has_those_of_humble(tmp_path: Path) -> None:
    make = Messages()
    file = write_bag(tmp_path, [("/odom", make.odometry(0.5))], definitions=False)
    assert RosBag().rows(file).time.tolist() == [0.5]
    other = write_bag(tmp_path, [("/objects", make.tracked(0.5))], definitions=False, name="other")
    with pytest.raises(InputError, match="no definition of autoware_perception_msgs/msg/TrackedObjects"):
        RosBag().rows(other)


def test_the_folder_of_a_bag_is_named_by_its_metadata(tmp_path: Path) -> None:
    file = write_bag(tmp_path, [("/odom", Messages().odometry(0.5))])
    assert len(RosBag().rows(file.with_name(BAG))) == 1


def test_what_cannot_be_meant_is_named(tmp_path: Path) -> None:
    make = Messages()
    cases = {
        "2 topics with tracks: name one in topic: /a, /b": [
            ("/a", make.odometry(0)),
            ("/b", make.odometry(0)),
        ],
        "one frame .* is needed, and tracks are in map, odom": [
            ("/a", make.odometry(0)),
            ("/a", make.odometry(1, "odom")),
        ],
        "there are no tracks in this file; known are messages of nav_msgs": [("/a", make.header(0, "map"))],
        "a detection has no id": [("/a", make.detections(0, name=""))],
        "row 1: x is not a finite number": [("/a", make.odometry(0))],
    }
    cases["row 1: x is not a finite number"][0][1].pose.pose.position.x = np.nan
    for number, (message, messages) in enumerate(cases.items()):
        file = write_bag(tmp_path, messages, name=f"bag{number}")
        with pytest.raises(InputError, match=message):
            RosBag().rows(file).ordered(file)
        if number == 0:
            assert len(RosBag(topic="/b").rows(file)) == 1
            with pytest.raises(InputError, match="2 topics with tracks: name one in topic: /a, /b"):
                RosBag(topic="/c").rows(file)


def test_a_file_that_is_no_bag_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "cut.db3"
    file.write_bytes(write_bag(tmp_path, [("/odom", Messages().odometry(0.5))]).read_bytes()[:5000])
    with pytest.raises(InputError, match="not a ROS bag that can be read") as caught:
        RosBag().rows(file)
    assert "\n" not in str(caught.value)


def test_without_the_package_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with pytest.raises(InputError, match=r"pip install 'trackbench\[ros\]'"):
        RosBag().rows(tmp_path / "bag.db3")
