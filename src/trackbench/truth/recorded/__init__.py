"""Truth and measurements that come from a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from trackbench.base.types import Truth
from trackbench.truth.base import Recorded
from trackbench.truth.config import RecordingOptions
from trackbench.truth.recorded.cycles import require_long_enough
from trackbench.truth.recorded.drive import (
    Drive,
    counts_left_out,
    grid,
    measurements_on_grid,
    notes,
    require_measurements,
    scan_cycles,
    truth_on_grid,
)
from trackbench.truth.recorded.reference import with_scored_region
from trackbench.truth.recorded.scans import recorded_detections, scan_notes
from trackbench.truth.recorded.table import load_tables, load_unlabelled
from trackbench.truth.recorded.udacity import load_udacity

__all__ = ["Drive", "Recording", "load_recording", "read_drive"]


class Recording(NamedTuple):
    """Content of a file, on one grid of times."""

    truth: Truth
    measurements: dict[str, Recorded]
    """By sensor."""
    notes: tuple[str, ...]
    """Rows that were sorted or left out, a line each."""


def load_recording(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Recording:
    """Read a recording.

    Args:
        config: the ``truth`` of a scenario.
        kinds: the kind of each of the scenario's sensors.
        folder: where relative paths start.

    Raises:
        InputError: a file cannot be read or is damaged, with its name and line (row, where there are no lines).
    """
    recording = _on_grid(config, read_drive(config, kinds, folder), kinds)
    if config.stretches is not None:
        require_long_enough(recording.truth, recording.measurements, config.stretches)
    if (
        recording.measurements
        and config.format != "udacity"
        and config.carrier is None
        and "observer" not in config.model_fields_set
    ):
        note = "no observer is stated: the sensors stand at x = 0, y = 0 with yaw 0"
        return recording._replace(notes=(note, *recording.notes))
    return recording


def _on_grid(config: RecordingOptions, drive: Drive, kinds: Mapping[str, str]) -> Recording:
    clipped = drive.clipped()
    require_measurements(drive, clipped)
    looked = scan_cycles(clipped)
    times = grid(clipped, looked)
    counts = counts_left_out(drive, clipped, hidden=config.hidden)
    truth = truth_on_grid(config, clipped, times)
    source = {"source": "recording", "format": config.format, "recorded": drive.sensors, **truth.source}
    truth = replace(truth, source={**source, **({"left_out": counts} if counts else {})})
    result: dict[str, Recorded] = {
        name: measurements_on_grid(log, kinds[name], looked[name], times, len(truth.ids))
        for name, log in clipped.logs.items()
    }
    lines = [*notes(drive, counts)]
    detections = drive.detections
    if config.hidden and drive.has_truth:
        truth = with_scored_region(truth, config.reference, clipped)
        # Objects have numbers of their own.
        detections = {name: of.without_slots() for name, of in detections.items()}
    result |= {name: recorded_detections(of, times) for name, of in detections.items()}
    lines += scan_notes(detections, times, "truth" if drive.has_truth else "observer")
    return Recording(truth, result, tuple(lines))


def read_drive(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """Read the files of a recording; see :func:`load_recording`."""
    if config.without_truth:
        return load_unlabelled(config, kinds, folder)
    load = load_udacity if config.format == "udacity" else load_tables
    return load(config, kinds, folder)
