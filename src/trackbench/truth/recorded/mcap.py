"""The messages of MCAP files, and the columns of a log that they hold.

Source: MCAP format specification, foxglove.dev, "Well-known profiles and encodings".
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from trackbench.base.errors import InputError, counted, nearest_choices, shortened_text
from trackbench.base.files import read_bytes
from trackbench.base.plugins import one_line
from trackbench.truth.recorded import foxglove

#: Largest file, bytes.
MOST = 2**32


class Message(NamedTuple):
    """One message of a file."""

    topic: str
    schema: str
    encoding: str
    """Such as ``json``."""
    data: bytes


class LogPart(NamedTuple):
    """What is read of a file that holds several things."""

    what: str
    """boxes, detections, tracks or frame."""
    name: str | None
    """Of the topic, which may be left out where one alone has such messages, or of the frame."""


#: The messages that have detections; those before are taken where a file has both.
DETECTIONS = (foxglove.POINTS, foxglove.SCAN)


def log_columns(file: Path, part: LogPart) -> dict[str, Sequence[Any]]:
    """What a part of a file holds, as columns in SI units and radians.

    Raises:
        InputError: the file cannot be read, or does not have it.
    """
    if part.what == "detections":
        own = of_topic(messages_of(file, {*DETECTIONS}), DETECTIONS, part, file)
        return foxglove.columns_of_detections(decoded(own, file), own[0].schema, file)
    messages = messages_of(file, {foxglove.BOXES, foxglove.TRANSFORMS})
    transforms = decoded([message for message in messages if message.schema == foxglove.TRANSFORMS], file)
    if part.what == "frame":
        return foxglove.columns_of_frame(part.name or "", transforms, file)
    own = of_topic(messages, (foxglove.BOXES,), part, file)
    return foxglove.columns_of_boxes(decoded(own, file), transforms, file)


def of_topic(messages: Sequence[Message], schemas: Collection[str], part: LogPart, file: Path) -> list[Message]:
    """Return the messages of one topic: of the first of the schemas that is there, unless the topic is named.

    Raises:
        InputError: as of :func:`chosen_topic`.
    """
    topics = {message.topic: message.schema for message in messages if message.schema in schemas}
    if part.name is None:
        first = next((schema for schema in schemas if schema in topics.values()), None)
        topics = {topic: schema for topic, schema in topics.items() if schema == first}
    topic = chosen_topic(topics, schemas, part, file)
    return [message for message in messages if message.topic == topic and message.schema == topics[topic]]


def chosen_topic(topics: Mapping[str, str], schemas: Collection[str], part: LogPart, file: Path) -> str:
    """Return the topic that is named, or the only one.

    Args:
        topics: the type of the messages of each topic that may be meant.
        schemas: types that are known.
        part: what is looked for.
        file: for error messages.

    Raises:
        InputError: there are none, or several topics have such messages and none is named.
    """
    what, topic = part
    if topic is not None and topic not in topics:
        raise InputError(f"there is no topic {topic!r} with {what}; {nearest_choices(topic, topics)}", file=file)
    if not topics:
        message = f"there are no {what} in this file; known are messages of {', '.join(schemas)}"
        raise InputError(message + "; format ros reads bags of ROS 2" * (foxglove.TRACKS in schemas), file=file)
    if topic is None and len(topics) > 1:
        have = f"{counted(len(topics), 'topic')} have {next(iter(topics.values()))}"
        raise InputError(f"{have}: name one in topic: {foxglove.first_names(topics)}", file=file)
    return topic or next(iter(topics))


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
            raise InputError(
                f"not an MCAP file that can be read: {shortened_text(one_line(error))}", file=file
            ) from None


def decoded(messages: Sequence[Message], file: Path) -> list[object]:
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
