"""Tracks and boxes in MCAP: what is read and what is refused."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.mcap_files import mcap_messages, write_tracks

from trackbench.base.errors import InputError
from trackbench.truth.formats.mcap import Mcap
from trackbench.truth.tracks import TrackRows

pytest.importorskip("mcap", reason="needs trackbench[mcap]")
Messages = list[tuple[str, str, Any]]


def file_of(folder: Path, messages: Messages) -> Path:
    file = folder / "tracks.mcap"
    with mcap_messages(file) as write:
        for number, (topic, schema, message) in enumerate(messages):
            write(topic, schema, 0.1 * number, message)
    return file


def quaternion(yaw: float) -> dict[str, float]:
    return {"x": 0, "y": 0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def entity(time: float, x: float = 1.0, y: float = 2.0, yaw: float = 0.0, **more: Any) -> dict[str, Any]:
    cube = {
        "pose": {"position": {"x": x, "y": y, "z": 0}, "orientation": quaternion(yaw)},
        "size": {"x": 4.5, "y": 1.8, "z": 1.5},
    }
    stamp = {"sec": math.floor(time), "nsec": round(time % 1 * 1e9)}
    return {"timestamp": stamp, "frame_id": "map", "id": "7", "cubes": [cube], "metadata": [], **more}


def boxes(*entities: dict[str, Any]) -> tuple[str, str, Any]:
    return "/boxes", "foxglove.SceneUpdate", {"deletions": [], "entities": list(entities)}


def move(time: float, parent: str, child: str, x: float, y: float, yaw: float) -> tuple[str, str, Any]:
    translation = {"x": x, "y": y, "z": 0}
    stamp = {"sec": int(time), "nsec": round(time % 1 * 1e9)}
    own = {"timestamp": stamp, "parent_frame_id": parent, "child_frame_id": child}
    return (
        "/tf",
        "foxglove.FrameTransforms",
        {"transforms": [own | {"translation": translation, "rotation": quaternion(yaw)}]},
    )


def test_tracks_come_back_bit_for_bit(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    factor = random.standard_normal((4, 4, 30))
    covariance = np.einsum("ikr,jkr->ijr", factor, factor)
    time = np.sort(random.random(10)).repeat(3)
    numbers = random.standard_normal((4, 30)) * 1e3
    texts = {"scene": ["0"] * 30, "run": ["0", "1", "2"] * 10, "fingerprint": ["a", "b", "c"] * 10}
    rows = TrackRows(
        [str(k % 5) for k in range(30)], time, *numbers, covariance=covariance, existence=random.random(30), **texts
    )
    write_tracks(rows, tmp_path / "tracks.mcap")
    back = Mcap().rows(tmp_path / "tracks.mcap")
    for name in ("time", "px", "py", "vx", "vy", "covariance", "existence"):
        np.testing.assert_array_equal(getattr(back, name), getattr(rows, name))
    assert (back.id, back.scene, back.run, back.fingerprint) == (rows.id, rows.scene, rows.run, rows.fingerprint)


def test_boxes_have_the_time_of_their_entity_and_of_the_clock(tmp_path: Path) -> None:
    rows = Mcap().rows(file_of(tmp_path, [boxes(entity(1_700_000_000.25)), boxes(entity(1_700_000_001.5, yaw=2.5))]))
    assert rows.start == Decimal(1_700_000_000)
    np.testing.assert_allclose(rows.time, [0.25, 1.5], atol=1e-9)
    assert rows.heading is not None
    np.testing.assert_allclose(rows.heading, [0, 2.5])
    assert rows.vx is None
    assert rows.length is not None
    assert rows.length.tolist() == [4.5, 4.5]


def test_boxes_in_several_frames_or_in_a_moving_one_are_refused(tmp_path: Path) -> None:
    for other in (boxes(entity(0, frame_id="odom")), move(0, "odom", "map", 1, 0, 0)):
        with pytest.raises(InputError, match="one frame that is fixed to the ground is needed, and tracks are in map"):
            Mcap().rows(file_of(tmp_path, [boxes(entity(0)), other]))


def test_one_of_several_topics_is_named(tmp_path: Path) -> None:
    other = ("/mine", *boxes(entity(0))[1:])
    file = file_of(tmp_path, [boxes(entity(0)), other])
    with pytest.raises(InputError, match="2 topics with tracks: name one in topic: /boxes, /mine"):
        Mcap().rows(file)
    assert len(Mcap(topic="/mine").rows(file)) == 1
    with pytest.raises(InputError, match="2 topics with tracks: name one in topic: /boxes, /mine"):
        Mcap(topic="/min").rows(file)


def changed(change: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    item = json.loads(json.dumps(entity(0)))
    change(item)
    return item


BAD_BOXES: list[tuple[dict[str, Any], str]] = [
    (changed(lambda item: item.pop("id")), "message 1 of foxglove.SceneUpdate is damaged: KeyError: 'id'"),
    (changed(lambda item: item["cubes"][0]["pose"]["position"].update(x="a")), "x is not a finite number: 'a'"),
    (changed(lambda item: item.update(cubes=3)), "message 1 of foxglove.SceneUpdate is damaged"),
    (changed(lambda item: item.update(cubes=[])), "there is no track in this file"),
    (changed(lambda item: item.update(timestamp=[])), "message 1 of foxglove.SceneUpdate is damaged"),
]


@pytest.mark.parametrize(("item", "message"), BAD_BOXES)
def test_what_is_wrong_with_a_box(item: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        Mcap().rows(file_of(tmp_path, [boxes(item)]))
    assert message in str(caught.value)
    assert "tracks.mcap" in str(caught.value)


BAD_TRACKS: list[tuple[dict[str, Any], str]] = [
    ({"tracks": []}, "KeyError: 'time_s'"),
    ({"time_s": 0, "tracks": []}, "there is no track in this file"),
    ({"time_s": 0, "tracks": [{"id": "1", "mean": [1, 2]}]}, "message 1 of trackbench.Tracks is damaged"),
    ({"time_s": 0, "tracks": [{"id": "1", "mean": [1, 2, 3, True]}]}, "vy is not a finite number: 'True'"),
    ({"time_s": 0, "tracks": [{"id": "1", "mean": [1, 2, 3, 4], "covariance": [[1]]}]}, "is damaged"),
    (
        {"time_s": 0, "tracks": [{"id": "1", "mean": [1, 2, 3, 4], "existence": 1.5}]},
        "and 0 to 1 can be meant",
    ),
    ({"time_s": 0, "tracks": [4]}, "message 1 of trackbench.Tracks is damaged"),
]


@pytest.mark.parametrize(("message", "problem"), BAD_TRACKS)
def test_what_is_wrong_with_tracks(message: dict[str, Any], problem: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        Mcap().rows(file_of(tmp_path, [("/tracks", "trackbench.Tracks", message)]))
    assert problem in str(caught.value)
