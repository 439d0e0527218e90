"""MCAP files: tracks and boxes as JSON, and messages of OSI.

Sources: MCAP format specification; Foxglove schemas, ``foxglove.SceneUpdate`` and ``foxglove.FrameTransforms``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from pydantic import Field

from trackbench.base.errors import InputError, counted, shortened_text
from trackbench.base.files import require_regular
from trackbench.base.plugins import one_line
from trackbench.truth.config.columns import Column
from trackbench.truth.formats import osi
from trackbench.truth.formats.tables import QUANTITIES, table_rows
from trackbench.truth.recorded.rows import rows_of_columns
from trackbench.truth.tracks import COVARIANCE, TrackRows, TrafficFormat

#: Schemas of messages.
BOXES, TRANSFORMS = "foxglove.SceneUpdate", "foxglove.FrameTransforms"
TRACKS, SCAN = "trackbench.Tracks", "trackbench.Scan"
#: Metadata of a box by column.
VELOCITY = {"vx": "vx_mps", "vy": "vy_mps"}
OF_RUN = ("scene", "run", "fingerprint")

Row = dict[str, Any]


class Message(NamedTuple):
    """Encoded message in an MCAP file, with its topic and schema."""

    topic: str
    schema: str
    encoding: str
    """Name of the encoding, such as ``json``."""
    data: bytes


class Mcap(TrafficFormat):
    """MCAP with trackbench.Tracks, foxglove.SceneUpdate (JSON), or messages of OSI. Needs `trackbench[mcap]`."""

    endings: ClassVar[tuple[str, ...]] = (".mcap",)
    topic: str | None = Field(
        None, min_length=1, description="The topic with the tracks; needed only where several have some."
    )

    def rows(self, file: Path) -> TrackRows:
        messages = messages_of(file, {*READERS, TRANSFORMS})
        schemas = {message.topic: message.schema for message in messages if message.schema in READERS}
        if self.topic is None:
            first = next((schema for schema in READERS if schema in schemas.values()), None)
            schemas = {topic: schema for topic, schema in schemas.items() if schema == first}
        topic = chosen_topic(schemas, READERS, self.topic, file)
        topic_messages = [message for message in messages if message.topic == topic]
        return READERS[schemas[topic]](topic_messages, file, [item for item in messages if item.schema == TRANSFORMS])


def messages_of(file: Path, schemas: set[str]) -> list[Message]:
    """Return the messages whose schema is one of ``schemas``, sorted by log time.

    Raises:
        InputError: the file cannot be read, or ``trackbench[mcap]`` is not installed.
    """
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise InputError("MCAP needs one more package: pip install 'trackbench[mcap]'", file=file) from None
    require_regular(file)
    try:
        with file.open("rb") as stream:
            return [
                Message(channel.topic, schema.name, channel.message_encoding, message.data)
                for schema, channel, message in make_reader(stream).iter_messages()
                if schema is not None and schema.name in schemas
            ]
    except Exception as error:  # A damaged length can cause any exception in the reader.
        raise InputError(f"not an MCAP file that can be read: {shortened_text(one_line(error))}", file=file) from None


def chosen_topic(topics: Mapping[str, str], schemas: Iterable[str], topic: str | None, file: Path) -> str:
    """Return the topic named in the scenario, or else the only topic with tracks.

    Args:
        topics: message type of each topic with tracks, by the name of the topic.
        schemas: message types that can be read as tracks.
        topic: name of the topic in the scenario; None if none is named.
        file: file, for error messages.

    Raises:
        InputError: no topic has tracks, the named topic has none, or several have tracks and none is named.
    """
    if not topics:
        message = f"there are no tracks in this file; known are messages of {', '.join(schemas)}"
        raise InputError(message + "; format ros reads bags of ROS 2" * (TRACKS in schemas), file=file)
    chosen = next(iter(topics)) if topic is None and len(topics) == 1 else topic
    if chosen is None or chosen not in topics:
        choices = ", ".join(shortened_text(name, 40) for name in sorted(topics)[:5])
        raise InputError(f"{counted(len(topics), 'topic')} with tracks: name one in topic: {choices}", file=file)
    return chosen


def _osi(messages: Sequence[Message], file: Path, _: Sequence[Message]) -> TrackRows:
    kind = next(kind for kind in osi.KINDS if messages[0].schema == f"osi3.{kind}")
    return osi.moving_objects(file, kind, [memoryview(message.data) for message in messages])


def _tracks(messages: Sequence[Message], file: Path, _: Sequence[Message]) -> TrackRows:
    return rows_of_messages(_parsed(messages, _tracks_in, file), file)


def _boxes(messages: Sequence[Message], file: Path, transforms: Sequence[Message]) -> TrackRows:
    moved = {child for row in _parsed(transforms, _children_in, file) for child in row}
    return rows_of_messages(_parsed(messages, _boxes_in, file), file, moved)


def rows_of_messages(rows: Sequence[Row], file: Path, moved: Collection[str] = ()) -> TrackRows:
    """Return rows read from messages as columns, with their time and id.

    Args:
        rows: values of each row by column (time, id, px and so on), and possibly the frame. A column that some rows
            lack is not read, except covariance and existence.
        file: file, for error messages.
        moved: names of the coordinate frames that move over the ground.

    Raises:
        InputError: there is no row, a row is damaged, or the rows are in several frames or a moving frame.
    """
    if not rows:
        raise InputError("there is no track in this file", file=file)
    frames = {str(row["frame"]) for row in rows if "frame" in row}
    if len(frames) > 1 or frames & {*moved}:
        names = ", ".join(shortened_text(name, 40) for name in sorted(frames)[:5])
        raise InputError(f"one frame that is fixed to the ground is needed, and tracks are in {names}", file=file)
    names_read = [
        name for name in QUANTITIES if (any if name in (*COVARIANCE, "existence") else all)(name in row for row in rows)
    ]
    table = rows_of_columns(file, {name: [row.get(name) for row in rows] for name in names_read})
    return table_rows(table, {name: Column(name, QUANTITIES[name]) for name in names_read})


def _parsed(messages: Sequence[Message], rows_in: Callable[[Any], Iterator[Row]], file: Path) -> list[Row]:
    rows: list[Row] = []
    for number, message in enumerate(messages, 1):
        if message.encoding != "json":
            problem = f"{message.topic} has {message.schema} in the encoding {message.encoding!r}; only json is read"
            raise InputError(problem, file=file)
        try:
            rows += rows_in(json.loads(message.data))
        except (TypeError, LookupError, AttributeError, ValueError, ArithmeticError, RecursionError) as error:
            problem = f"message {number} of {message.schema} is damaged: {one_line(error)}"
            raise InputError(problem, file=file) from None
    return rows


def _tracks_in(message: Any) -> Iterator[Row]:
    common = {"time": message["time_s"], **{key: message[key] for key in OF_RUN if key in message}}
    for track in message["tracks"]:
        mean = dict(zip(("x", "y", "vx", "vy"), track["mean"], strict=True))
        row = {**common, "id": track["id"], **mean}
        if track.get("existence") is not None:
            row["existence"] = track["existence"]
        if track.get("covariance") is not None:
            row |= {name: track["covariance"][a][b] for name, (a, b) in COVARIANCE.items()}
        yield row


def _boxes_in(message: Any) -> Iterator[Row]:
    for entity in message["entities"]:
        for cube in entity.get("cubes", []):
            position, turn, size = cube["pose"]["position"], cube["pose"]["orientation"], cube["size"]
            metadata = {pair["key"]: pair["value"] for pair in entity.get("metadata", [])}
            yield {
                "time": time_of(entity["timestamp"]["sec"], entity["timestamp"]["nsec"]),
                "id": entity["id"],
                "frame": entity["frame_id"],
                "x": position["x"],
                "y": position["y"],
                "heading": yaw_of(*(turn[key] for key in "xyzw")),
                "length": size["x"],
                "width": size["y"],
                **{key: metadata[name] for key, name in VELOCITY.items() if name in metadata},
            }


def time_of(seconds: Any, nanoseconds: Any) -> Decimal:
    """Return the time, s, of a stamp made of whole seconds and nanoseconds."""
    return Decimal(int(seconds)) + Decimal(int(nanoseconds)).scaleb(-9)


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Return the yaw, rad, of a quaternion: its rotation about the vertical axis."""
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))


def _children_in(message: Any) -> Iterator[Row]:
    yield {str(transform["child_frame_id"]): None for transform in message["transforms"]}


#: Readers of messages with tracks, by schema; the first schema present in a file is read.
READERS: dict[str, Callable[[Sequence[Message], Path, Sequence[Message]], TrackRows]] = {
    TRACKS: _tracks,
    BOXES: _boxes,
    **dict.fromkeys((f"osi3.{kind}" for kind in osi.KINDS), _osi),
}
