"""Recordings read back by Rerun's reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import RrdReader


class ReadRecording:
    """A recording: for an entity and a component, values by time in seconds (None: static)."""

    def __init__(self, path: Path) -> None:
        self.parts: dict[tuple[str, str], list[tuple[Any, pa.Array]]] = {}
        self.timelines: set[str] = set()
        for chunk in RrdReader(path).stream():
            batch = chunk.to_record_batch()
            self.timelines.update(chunk.timeline_names)
            times = [None] * len(batch) if chunk.is_static else batch.column("sim_time").to_numpy().astype(float) / 1e9
            for name in batch.schema.names:
                self.parts.setdefault((chunk.entity_path, name), []).append((times, batch.column(name)))

    def __call__(self, entity: str, component: str) -> dict[float | None, Any]:
        parts = self.parts[entity, component]
        return {time: value for times, column in parts for time, value in zip(times, column.to_pylist(), strict=True)}

    def entities(self) -> set[str]:
        return {entity for entity, _ in self.parts}


def shown_views(file: Path) -> set[str]:
    """The names of the views of every layout in a recording."""
    reader = RrdReader(file)
    return {
        name
        for store in reader.blueprints()
        for chunk in reader.stream(store=store)
        if "ViewBlueprint:display_name" in (batch := chunk.to_record_batch()).schema.names
        for (name,) in batch.column("ViewBlueprint:display_name").to_pylist()
    }
