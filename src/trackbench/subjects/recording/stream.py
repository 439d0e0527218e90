"""What the parts of a recording write to: entities by path, columns over simulated time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import rerun as rr
from rerun import AsComponents, ComponentColumn

from trackbench.base.types import Array

#: The recording's one timeline, seconds of simulated time.
TIMELINE = "sim_time"


def path(*parts: str) -> str:
    """An entity path; names are escaped, so that any name of a tracker or sensor is one part."""
    return str(rr.new_entity_path(list(parts)))


def rgba(colour: str) -> int:
    """An opaque colour out of "#RRGGBB"."""
    return int(colour[1:] + "FF", 16)


def pixels(size: float) -> float:
    """A radius on the screen, whatever the zoom: Rerun takes negative radii for that."""
    return -size


class Stream:
    """One recording that is being written."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording

    def static(self, entity: str, *archetypes: AsComponents) -> None:
        """What does not change over time."""
        self._recording.log(entity, *archetypes, static=True, strict=True)

    def columns(self, entity: str, time: Array, *batches: Iterable[ComponentColumn]) -> None:
        """What changes over time: one row for each of ``time`` (s) in every batch."""
        if len(time):
            nanoseconds = np.round(time * 1e9).astype("timedelta64[ns]")
            index: Any = rr.TimeColumn(TIMELINE, duration=nanoseconds)
            flat = [column for batch in batches for column in batch]
            self._recording.send_columns(entity, [index], flat, strict=True)

    def markdown(self, entity: str, text: str) -> None:
        """A text."""
        self.static(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
