"""MCAP: tracks and boxes as JSON, and messages of OSI."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from trackbench.truth.formats import osi
from trackbench.truth.formats.tables import QUANTITIES, ColumnLayout, table_rows
from trackbench.truth.recorded import foxglove
from trackbench.truth.recorded.mcap import LogPart, Message, decoded, messages_of, of_topic
from trackbench.truth.recorded.rows import rows_of_columns
from trackbench.truth.tracks import TrackRows, TrafficFormat


def _osi(messages: Sequence[Message], file: Path, _: Sequence[Message]) -> TrackRows:
    kind = next(kind for kind in osi.KINDS if messages[0].schema == f"osi3.{kind}")
    return osi.moving_objects(file, kind, [memoryview(message.data) for message in messages])


def _tracks(messages: Sequence[Message], file: Path, _: Sequence[Message]) -> TrackRows:
    return _rows(foxglove.columns_of_tracks(decoded(messages, file), file), file)


def _boxes(messages: Sequence[Message], file: Path, transforms: Sequence[Message]) -> TrackRows:
    columns = foxglove.columns_of_boxes(decoded(messages, file), decoded(transforms, file), file)
    named = dict(zip(foxglove.VELOCITY, ("vx", "vy"), strict=True))
    if any(None in columns.get(key, [None]) for key in named):
        named = dict.fromkeys(named, "")
    return _rows({named.get(name, name): values for name, values in columns.items()}, file)


def _rows(columns: Mapping[str, Sequence[Any]], file: Path) -> TrackRows:
    """The rows of a table that is called as ours is."""
    columns_of_keys = {name: name for name in QUANTITIES if name in columns}
    layout = ColumnLayout(columns_of_keys, {})
    return table_rows(rows_of_columns(file, columns), layout, dict.fromkeys(QUANTITIES, 1.0))


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

    def rows(self, file: Path) -> TrackRows:
        messages = messages_of(file, {*READERS, foxglove.TRANSFORMS})
        own = of_topic(messages, READERS, LogPart("tracks", self.topic), file)
        transforms = [message for message in messages if message.schema == foxglove.TRANSFORMS]
        return READERS[own[0].schema](own, file, transforms)
