"""MCAP: tracks and boxes as JSON, and messages of OSI.

Sources: MCAP format specification, foxglove.dev, "Well-known profiles and encodings"; Foxglove schemas,
``foxglove.SceneUpdate`` and ``foxglove.FrameTransforms``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple

from pydantic import Field

from trackbench.base.errors import InputError, counted, nearest, shortened
from trackbench.base.files import read_bytes
from trackbench.base.plugins import one_line
from trackbench.truth.formats import foxglove, osi
from trackbench.truth.track_rows import TrackRows
from trackbench.truth.tracks import TrafficFormat, TrafficTrack, bodies_of

#: Largest file, bytes.
MOST = 2**32


class Message(NamedTuple):
    """One message of a file."""

    topic: str
    schema: str
    encoding: str
    """Such as ``json``."""
    data: bytes


def _osi(messages: Sequence[Message], file: Path, _: Sequence[Message]) -> TrackRows:
    kind = next(kind for kind in osi.KINDS if messages[0].schema == f"osi3.{kind}")
    return osi.moving_objects(file, kind, [memoryview(message.data) for message in messages])


def _tracks(messages: Sequence[Message], file: Path, _: Sequence[Message]) -> TrackRows:
    return foxglove.rows_of_tracks(_decoded(messages, file), file)


def _boxes(messages: Sequence[Message], file: Path, transforms: Sequence[Message]) -> TrackRows:
    return foxglove.rows_of_boxes(_decoded(messages, file), _decoded(transforms, file), file)


#: What has tracks, by schema; of those in a file the first is read.
READERS: dict[str, Callable[[Sequence[Message], Path, Sequence[Message]], TrackRows]] = {
    foxglove.TRACKS: _tracks,
    foxglove.BOXES: _boxes,
    **dict.fromkeys((f"osi3.{kind}" for kind in osi.KINDS), _osi),
}


class Mcap(TrafficFormat):
    """MCAP with trackbench.Tracks, foxglove.SceneUpdate (JSON), or messages of OSI. Needs `trackbench[mcap]`."""

    endings: ClassVar[tuple[str, ...]] = (".mcap",)
    topic: str | None = Field(
        None, min_length=1, description="The topic with the tracks; needed only where several have some."
    )

    def read(self, file: Path) -> list[TrafficTrack]:
        return bodies_of(self.rows(file), file)

    def rows(self, file: Path) -> TrackRows:
        messages = messages_of(file, {*READERS, foxglove.TRANSFORMS})
        topics = {message.topic: message.schema for message in messages if message.schema in READERS}
        if self.topic is not None and self.topic not in topics:
            problem = f"there is no topic {self.topic!r} with tracks; {nearest(self.topic, topics)}"
            raise InputError(problem, file=file)
        if self.topic is not None:
            topics = {self.topic: topics[self.topic]}
        schema = next((schema for schema in READERS if schema in topics.values()), None)
        if schema is None:
            raise InputError(f"there are no tracks in this file; known are messages of {', '.join(READERS)}", file=file)
        chosen = [topic for topic, of_topic in topics.items() if of_topic == schema]
        if len(chosen) > 1:
            raise InputError(
                f"{counted(len(chosen), 'topic')} have {schema}: name one in topic: {_listed(chosen)}", file=file
            )
        own = [message for message in messages if message.topic == chosen[0] and message.schema == schema]
        return READERS[schema](own, file, [message for message in messages if message.schema == foxglove.TRANSFORMS])


def messages_of(file: Path, schemas: set[str]) -> list[Message]:
    """The messages of some schemas, in the order of their log time.

    Raises:
        InputError: the file cannot be read, or the package is missing.
    """
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise InputError("MCAP needs one more package: pip install 'trackbench[mcap]'", file=file) from None
    read_bytes(file, most=MOST)
    with file.open("rb") as stream:
        try:
            return [
                Message(channel.topic, schema.name, channel.message_encoding, message.data)
                for schema, channel, message in make_reader(stream).iter_messages()
                if schema is not None and schema.name in schemas
            ]
        except Exception as error:  # The reader of MCAP lets whatever a damaged length leads to through.
            raise InputError(f"not an MCAP file that can be read: {shortened(one_line(error))}", file=file) from None


def _decoded(messages: Sequence[Message], file: Path) -> list[object]:
    """The values of JSON messages."""
    values = []
    for number, message in enumerate(messages):
        if message.encoding != "json":
            problem = f"{message.topic} has {message.schema} in the encoding {message.encoding!r}; only json is read"
            raise InputError(problem, file=file)
        try:
            values.append(json.loads(message.data))
        except (ValueError, RecursionError) as error:
            problem = f"message {number + 1} of {message.topic} is not JSON: {one_line(error)}"
            raise InputError(problem, file=file) from None
    return values


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
