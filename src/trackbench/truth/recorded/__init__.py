"""Truth and measurements that come from a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from trackbench.truth.config import RecordingOptions
from trackbench.types import RecordedMeasurements, Truth

__all__ = ["Recording", "load"]


class Recording(NamedTuple):
    """What a file says."""

    truth: Truth
    measurements: dict[str, RecordedMeasurements]
    """By sensor."""


def load(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Recording:
    """Read a recording.

    Args:
        config: the ``truth`` of a scenario.
        kinds: the kind of each of the scenario's sensors.
        folder: where relative paths start.

    Raises:
        InputError: a file cannot be read or is damaged, with its name and line (row, where there are no lines).
    """
    from trackbench.truth.recorded import table, udacity_file

    if config.format == "udacity":
        return Recording(*udacity_file.load(config, kinds, folder))
    return Recording(*table.load(config, kinds, folder))
