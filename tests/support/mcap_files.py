"""Tracks in MCAP, as messages."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.truth.formats.mcap import TRACKS
from trackbench.truth.tracks import TrackRows


@contextmanager
def mcap_messages(path: Path) -> Iterator[Callable[[str, str, float, Any], None]]:
    """Open a new file, and yield what writes a message: ``(topic, name of its schema, log time s, message)``."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(library="trackbench")
        channels: dict[str, int] = {}

        def write(topic: str, schema: str, time: float, message: Any) -> None:
            if topic not in channels:
                number = writer.register_schema(schema, "jsonschema", b'{"type":"object"}')
                channels[topic] = writer.register_channel(topic, "json", number)
            nanoseconds = round(time * 1e9)
            writer.add_message(channels[topic], nanoseconds, json.dumps(message).encode(), nanoseconds)

        yield write
        writer.finish()  # type: ignore[no-untyped-call]


def write_tracks(rows: TrackRows, path: Path) -> None:
    """Tracks as ``trackbench.Tracks``, one message for each time; of several runs for each time and run."""
    keys = {name: getattr(rows, name) for name in ("scene", "run", "fingerprint") if getattr(rows, name) is not None}
    groups: dict[tuple[Any, ...], list[int]] = {}
    for row, time in enumerate(rows.time.tolist()):
        groups.setdefault((*(column[row] for column in keys.values()), time), []).append(row)
    with mcap_messages(path) as write:
        for (*of_run, time), members in groups.items():
            tracks = [_track(rows, row) for row in members]
            message = {
                **dict(zip(keys, of_run, strict=True)),
                "time_s": time,
                "tracks": tracks,
            }
            write("/tracks", TRACKS, time, message)


def _track(rows: TrackRows, row: int) -> dict[str, Any]:
    mean = [rows.px, rows.py, rows.vx, rows.vy]
    track: dict[str, Any] = {"id": rows.id[row], "mean": [float(part[row]) for part in mean if part is not None]}
    if rows.covariance is not None:
        values = rows.covariance[..., row].tolist()
        track["covariance"] = [[None if np.isnan(entry) else entry for entry in line] for line in values]
    if rows.existence is not None and np.isfinite(rows.existence[row]):
        track["existence"] = float(rows.existence[row])
    return track
