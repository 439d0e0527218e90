"""Ground truth and measurements from the files of a test drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from trackbench.truth.base import LoadedTruth, Recorded
from trackbench.truth.config.recording import RecordingOptions
from trackbench.truth.recorded.cycles import require_long_enough
from trackbench.truth.recorded.drive import (
    Drive,
    grid,
    left_out,
    measurements_on_grid,
    require_measurements,
    scan_cycles,
    truth_on_grid,
)
from trackbench.truth.recorded.reference import with_scored_region
from trackbench.truth.recorded.scans import recorded_detections
from trackbench.truth.recorded.table import load_tables
from trackbench.truth.recorded.udacity import load_udacity

__all__ = ["Drive", "load_recording", "read_drive"]


def load_recording(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> LoadedTruth:
    """Read a recording: truth and measurements at common times, and remarks on rows left out.

    Args:
        config: the scenario's ``truth``.
        kinds: kind (radar, lidar and so on) of each of the scenario's sensors, by name.
        folder: folder where relative paths start.

    Raises:
        InputError: a file cannot be read or is damaged; with its name, and its line or row.
    """
    drive = read_drive(config, kinds, folder)
    clipped = drive.clipped()
    require_measurements(drive, clipped)
    cycles = scan_cycles(clipped)
    times = grid(clipped, cycles)
    counts = left_out(drive, clipped, times, hidden=config.hidden)
    truth = truth_on_grid(config, clipped, times)
    source = {"source": "recording", "format": config.format, "recorded": drive.sensors, **truth.source}
    truth_counts = {name: values for name, values in counts.items() if name not in drive.detections}
    truth = replace(truth, source={**source, **({"left_out": truth_counts} if truth_counts else {})})
    measurements: dict[str, Recorded] = {
        name: measurements_on_grid(log, kinds[name], cycles[name], times, len(truth.ids))
        for name, log in clipped.logs.items()
    }
    detections = drive.detections
    if config.hidden and drive.has_truth:
        truth = with_scored_region(truth, config.reference, clipped)
        # With a truth, origins are numbers of objects, not of the sensor's tracks.
        detections = {
            name: s._replace(own_track=np.full(len(s.scan), -1), own_tracks=()) for name, s in detections.items()
        }
    measurements |= {name: recorded_detections(values, times) for name, values in detections.items()}
    if config.stretches is not None:
        require_long_enough(truth, measurements, config.stretches)
    notes = [f"{name}: left out {count} rows {why}" for name, values in counts.items() for why, count in values.items()]
    is_assumed = config.ego is None and "observer" not in config.model_fields_set and config.format != "udacity"
    if measurements and is_assumed:
        notes = ["no observer is stated: the sensors stand at x = 0, y = 0 with yaw 0", *notes]
    return LoadedTruth(truth, notes=tuple(notes), measurements=measurements)


def read_drive(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """Return the content of a recording's files; arguments as for :func:`load_recording`."""
    load = load_udacity if config.format == "udacity" else load_tables
    return load(config, kinds, folder)
