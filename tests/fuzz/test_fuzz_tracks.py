"""Whatever is in a file of tracks or boxes, it is read, or refused in one line."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.fuzz.mutations import cases, edited_bytes, edited_tree
from tests.support.ros_bags import Messages, write_bag
from tests.support.traffic_files import write_osi

from trackbench.base.errors import InputError
from trackbench.subjects.export.mcap import write_tracks
from trackbench.truth.formats.foxglove import rows_of_boxes, rows_of_tracks
from trackbench.truth.formats.mcap import Mcap
from trackbench.truth.formats.osi import OsiTrace
from trackbench.truth.formats.ros import RosBag
from trackbench.truth.track_rows import TrackRows

pytest.importorskip("mcap", reason="needs trackbench[mcap]")
pytest.importorskip("rosbags", reason="needs trackbench[ros]")
Read = Callable[[], TrackRows]

TRACKS = {
    "time_s": 0.5,
    "scene": 0,
    "run": 1,
    "fingerprint": "ab",
    "tracks": [
        {"id": "1", "mean": [1.0, 2.0, 3.0, 4.0], "covariance": np.eye(4).tolist(), "existence": 0.5},
        {"id": 2, "mean": [1.0, 2.0, 3.0, 4.0]},
    ],
}
TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
STAMP = {"sec": 1, "nsec": 500_000_000}
POSE = {"position": {"x": 1.0, "y": 2.0, "z": 0.0}, "orientation": TURN}
CUBE = {"pose": POSE, "size": {"x": 4.0, "y": 2.0, "z": 1.0}}
METADATA = [{"key": "vx_mps", "value": "1.5"}, {"key": "vy_mps", "value": "0"}]
BOXES = {
    "entities": [
        {"timestamp": STAMP, "frame_id": frame, "id": "a", "cubes": [CUBE], "metadata": METADATA}
        for frame in ("lidar", "map")
    ]
}
FRAMES = {"timestamp": STAMP, "parent_frame_id": "map", "child_frame_id": "lidar"}
TRANSFORMS = {"transforms": [FRAMES | {"translation": {"x": 1.0, "y": 0.0, "z": 0.0}, "rotation": TURN}]}


def edited(chance: random.Random, value: Any) -> Any:
    """A JSON value with an edit or a few, as a file of it would give it back."""
    for _ in range(chance.choice([1, 1, 1, 3])):
        value = edited_tree(chance, json.loads(json.dumps(value)))
    return json.loads(json.dumps(value))


def damages(folder: Path) -> dict[str, Callable[[random.Random], Read]]:
    """By name, what makes a damaged input of a format."""
    mcap = folder / "whole.mcap"
    numbers = np.arange(40.0).reshape(4, 10)
    write_tracks(TrackRows([*"abcdefghij"], np.arange(10) * 0.1, *numbers), mcap)
    make = Messages()
    bag = write_bag(folder, [("/objects", make.tracked(0.1 * k)) for k in range(5)])
    files = {"mcap": (mcap, Mcap()), "osi": (write_osi(folder), OsiTrace()), "ros": (bag, RosBag())}

    def bytes_of(name: str) -> Callable[[random.Random], Read]:
        file, form = files[name]
        whole, damaged = file.read_bytes(), folder / f"damaged{file.suffix}"

        def case(chance: random.Random) -> Read:
            damaged.write_bytes(edited_bytes(chance, whole))
            return lambda: form.rows(damaged)

        return case

    def tracks(chance: random.Random) -> Read:
        message = edited(chance, TRACKS)
        return lambda: rows_of_tracks([TRACKS, message], mcap)

    def boxes(chance: random.Random) -> Read:
        parts = [BOXES, TRANSFORMS]
        place = chance.randrange(2)
        parts[place] = edited(chance, parts[place])
        return lambda: rows_of_boxes([parts[0]], [parts[1]], mcap)

    return {"tracks": tracks, "boxes": boxes, **{name: bytes_of(name) for name in files}}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", ["tracks", "boxes", "mcap", "osi", "ros"])
def test_a_damaged_file_is_read_or_one_line(name: str, tmp_path: Path) -> None:
    damage, refused, faults = damages(tmp_path)[name], 0, []
    for case in cases(60):
        read = damage(random.Random(case))
        try:
            rows = read()
            numbers = np.stack([rows.time, rows.px, rows.py])
            if not np.isfinite(numbers).all():
                faults.append(f"case {case}: read as {numbers}")
        except InputError as error:
            refused += 1
            if "\n" in str(error) or not 0 < len(str(error)) < 600:
                faults.append(f"case {case}: {error}")
        except Exception as error:
            faults.append(f"case {case}: {type(error).__name__}: {error}")
    assert not faults, "\n".join(faults[:20])
    assert refused > 0
