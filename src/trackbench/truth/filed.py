"""The rows of a file of tracks that another program wrote."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from trackbench.truth.config.filed import TracksConfig
from trackbench.truth.config.logs import find_log
from trackbench.truth.track_rows import TrackRows
from trackbench.truth.tracks import TrafficFormat


def read_tracks(config: TracksConfig, name: str, folder: Path) -> TrackRows:
    """All rows of a file, in the order of time.

    Args:
        config: the scenario's entry.
        name: of the tracker.
        folder: the scenario's, where a relative path starts.

    Raises:
        InputError: there is no such file, or it is damaged.
    """
    file = find_log(config.path, folder, f"trackers.{name}.path")
    return read_rows(config.format, file).ordered(file)


def read_rows(form: TrafficFormat, file: Path) -> TrackRows:
    """All rows of a file, as they stand in it.

    Raises:
        InputError: it is damaged.
    """
    file = Path(os.path.normpath(file))
    version = file.stat()
    return _read(form, file, (version.st_mtime_ns, version.st_size))


@lru_cache(maxsize=8)
def _read(form: TrafficFormat, file: Path, _version: tuple[int, int]) -> TrackRows:
    return form.rows(file)
