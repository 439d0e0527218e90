"""Small files of recorded traffic, one in each format."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from shutil import rmtree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from tests.support.ros_bags import Body, Messages, write_bag

ROWS = 41
TIME = np.arange(ROWS) * 0.1
#: Two cars: one straight along x at 10 m/s, one along a bend; heading, speed, length, width.
CARS = {
    "1": (10.0 * TIME, 0.0 * TIME, 0.0 * TIME, 10.0 + 0.0 * TIME, 4.5, 1.8),
    "2": (
        20.0 + 40.0 * np.sin(0.2 * TIME),
        3.5 + 40.0 * (1.0 - np.cos(0.2 * TIME)),
        0.2 * TIME,
        8.0 + 0.0 * TIME,
        12.0,
        2.5,
    ),
}


def rows() -> dict[str, list[float] | list[str]]:
    """The columns of a table of one's own."""
    columns: dict[str, list[float] | list[str]] = {"id": [], "class": []}
    for name, (x, y, heading, speed, length, width) in CARS.items():
        columns["id"] += [name] * ROWS  # type: ignore[arg-type]
        columns["class"] += ["car"] * ROWS  # type: ignore[arg-type]
        own = {"time": TIME, "x": x, "y": y, "heading": heading, "speed": speed}
        for key, values in {**own, "length": 0 * TIME + length, "width": 0 * TIME + width}.items():
            columns.setdefault(key, []).extend(values.tolist())  # type: ignore[arg-type]
    return columns


def write_csv(folder: Path) -> Path:
    return _table(folder / "cars.csv", rows())


def write_parquet(folder: Path) -> Path:
    pq.write_table(pa.table(rows()), folder / "cars.parquet")
    return folder / "cars.parquet"


def _table(file: Path, columns: dict[str, list[float] | list[str]]) -> Path:
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def write_commonroad(folder: Path) -> Path:
    parts = []
    for name, (x, y, heading, speed, length, width) in CARS.items():
        states = [
            f"<position><point><x>{x[k]!r}</x><y>{y[k]!r}</y></point></position>"
            f"<orientation><exact>{heading[k]!r}</exact></orientation><time><exact>{k}</exact></time>"
            f"<velocity><exact>{speed[k]!r}</exact></velocity>".replace("np.float64(", "").replace(")", "")
            for k in range(ROWS)
        ]
        later = "".join(f"<state>{state}</state>" for state in states[1:])
        # The first as in version 2020a, the second as in 2018b.
        tag, role = ("dynamicObstacle", "") if name == "1" else ("obstacle", "<role>dynamic</role>")
        parts.append(
            f'<{tag} id="{name}">{role}<type>car</type>'
            f"<shape><rectangle><length>{length}</length><width>{width}</width></rectangle></shape>"
            f"<initialState>{states[0]}</initialState><trajectory>{later}</trajectory></{tag}>"
        )
    file = folder / "cars.xml"
    text = f'<commonRoad commonRoadVersion="2018b" timeStepSize="0.1">{"".join(parts)}</commonRoad>'
    file.write_text(text, encoding="utf-8")
    return file


def write_smarts(folder: Path) -> Path:
    file = folder / "cars.shf"
    file.unlink(missing_ok=True)
    base = sqlite3.connect(file)
    base.execute("CREATE TABLE Vehicle (id INTEGER PRIMARY KEY, type INTEGER, length REAL, width REAL)")
    base.execute(
        "CREATE TABLE Trajectory (vehicle_id, sim_time REAL, position_x REAL, position_y REAL, heading_rad, speed)"
    )
    for name, (x, y, heading, speed, length, width) in CARS.items():
        base.execute("INSERT INTO Vehicle VALUES (?, 2, ?, ?)", (int(name), length, width))
        values = zip([int(name)] * ROWS, *(v.tolist() for v in (TIME, x, y, heading - np.pi / 2, speed)), strict=True)
        base.executemany("INSERT INTO Trajectory VALUES (?, ?, ?, ?, ?, ?)", values)
    base.commit()
    base.close()
    return file


def write_ind(folder: Path) -> Path:
    columns: dict[str, list[float] | list[str]] = {"trackId": [], "frame": []}
    for name, (x, y, heading, speed, length, width) in CARS.items():
        columns["trackId"] += [name] * ROWS  # type: ignore[arg-type]
        columns["frame"] += [str(k) for k in range(ROWS)]  # type: ignore[arg-type]
        own = {"xCenter": x, "yCenter": y, "heading": np.rad2deg(heading), "length": 0 * x + length}
        own |= {"width": 0 * x + width, "xVelocity": speed * np.cos(heading), "yVelocity": speed * np.sin(heading)}
        for key, values in own.items():
            columns.setdefault(key, []).extend(values.tolist())  # type: ignore[arg-type]
    return _level_x(folder, "trackId", columns)


def write_highd(folder: Path) -> Path:
    """Both cars straight: highD's boxes lie along the picture, whose y points down."""
    columns: dict[str, list[float] | list[str]] = {"id": [], "frame": []}
    for name, (x, y, _, speed, length, width) in CARS.items():
        columns["id"] += [name] * ROWS  # type: ignore[arg-type]
        columns["frame"] += [str(k) for k in range(ROWS)]  # type: ignore[arg-type]
        own = {"x": x[0] + speed * TIME - length / 2, "y": 0 * x - y[0] - width / 2, "width": 0 * x + length}
        own |= {"height": 0 * x + width, "xVelocity": speed, "yVelocity": 0 * x}
        for key, values in own.items():
            columns.setdefault(key, []).extend(values.tolist())  # type: ignore[arg-type]
    return _level_x(folder, "id", columns)


def _level_x(folder: Path, key: str, columns: dict[str, list[float] | list[str]]) -> Path:
    (folder / "07_recordingMeta.csv").write_text("recordingId,frameRate\n7,10\n", encoding="utf-8")
    (folder / "07_tracksMeta.csv").write_text(f"recordingId,{key},class\n7,1,car\n7,2,truck\n", encoding="utf-8")
    return _table(folder / "07_tracks.csv", columns)


def write_osi(folder: Path) -> Path:
    file = folder / "cars_sv_.osi"
    file.write_bytes(b"".join(len(message).to_bytes(4, "little") + message for message in sensor_views()))
    return file


def write_mcap(folder: Path) -> Path:
    from mcap.writer import CompressionType, Writer

    file = folder / "cars.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema(name="osi3.SensorView", encoding="protobuf", data=b"")
        channel = writer.register_channel(topic="view", message_encoding="protobuf", schema_id=schema)
        for number, message in enumerate(sensor_views()):
            writer.add_message(channel, log_time=number, publish_time=number, data=message)
        writer.finish()
    return file


def write_ros(folder: Path) -> Path:
    rmtree(folder / "bag", ignore_errors=True)
    make = Messages()
    messages = []
    for step in range(ROWS):
        bodies = [
            Body(
                f"{name:>016}".encode(), number, (length, width), tuple(float(v[step]) for v in (x, y, heading, speed))
            )
            for number, (name, (x, y, heading, speed, length, width)) in enumerate(CARS.items(), 1)
        ]
        messages.append(("/objects", make.tracked(float(TIME[step]), bodies=bodies)))
    return write_bag(folder, messages)


def sensor_views() -> list[bytes]:
    """SensorView messages of OSI."""
    return [_field(7, _ground_truth(step)) for step in range(ROWS)]


def _ground_truth(step: int) -> bytes:
    stamp = _varint_field(1, step // 10) + _varint_field(2, step % 10 * 100_000_000)
    objects = []
    for name, (x, y, heading, speed, length, width) in CARS.items():
        vx, vy = speed[step] * np.cos(heading[step]), speed[step] * np.sin(heading[step])
        base = _vector(1, length, width, 1.5) + _vector(2, x[step], y[step], 0.0)
        base += _vector(3, 0.0, 0.0, heading[step]) + _vector(4, vx, vy, 0.0)
        attributes = _varint_field(3, 2) + _field(6, _varint_field(1, 4))
        objects.append(_field(5, _field(1, _varint_field(1, int(name))) + _field(2, base) + attributes))
    return _field(2, stamp) + b"".join(objects)


def _vector(number: int, *values: float) -> bytes:
    parts = (bytes([index << 3 | 1]) + struct.pack("<d", value) for index, value in enumerate(values, 1))
    return _field(number, b"".join(parts))


def _field(number: int, content: bytes) -> bytes:
    return bytes([number << 3 | 2]) + _varint(len(content)) + content


def _varint_field(number: int, value: int) -> bytes:
    return bytes([number << 3]) + _varint(value)


def _varint(value: int) -> bytes:
    result = b""
    while value > 127:
        result += bytes([value & 127 | 128])
        value >>= 7
    return result + bytes([value])


def write_motchallenge(folder: Path) -> Path:
    """Frames from 1, boxes in the picture that mean nothing here, and positions on the ground."""
    return _lines(
        folder / "gt.txt",
        (f"{k + 1},{name},1,2,3,4,1,{x[k]},{y[k]},0" for name, (x, y, *_) in CARS.items() for k in range(ROWS)),
    )


def write_kitti(folder: Path) -> Path:
    """Frames from 0, in the frame of the camera, with a region to be ignored in each."""
    lines = []
    for name, (x, y, heading, _, length, width) in CARS.items():
        for k in range(ROWS):
            place = f"{-y[k]} 1.5 {x[k]} {-heading[k] - np.pi / 2}"
            lines.append(f"{k} {name} Car 0 0 0 1 2 3 4 1.5 {width} {length} {place}")
    lines += [f"{k} -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10" for k in range(ROWS)]
    return _lines(folder / "0001.txt", lines)


def _lines(file: Path, lines: Iterable[str]) -> Path:
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


#: What has to be said of a format's files.
OPTIONS = {"motchallenge": {"rate_hz": 10}}
#: What writes a file, by format.
WRITERS: dict[str, Callable[[Path], Path]] = {
    "commonroad": write_commonroad,
    "csv": write_csv,
    "exid": write_ind,
    "highd": write_highd,
    "ind": write_ind,
    "kitti": write_kitti,
    "motchallenge": write_motchallenge,
    "osi": write_osi,
    "mcap": write_mcap,
    "parquet": write_parquet,
    "ros": write_ros,
    "round": write_ind,
    "smarts": write_smarts,
}
