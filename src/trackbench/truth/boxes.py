"""A truth from the boxes of a file: each counts where it is, and none is repaired or left out."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np

from trackbench.base.errors import InputError, counted
from trackbench.base.types import Array, Mask, Truth
from trackbench.truth.config.logs import find_log
from trackbench.truth.config.recording import FixedObserver
from trackbench.truth.config.traffic import BoxesOptions
from trackbench.truth.recorded.cycles import require_long_enough
from trackbench.truth.recorded.drive import Drive, Motion, RowOrder, grid, slope, truth_on_grid
from trackbench.truth.recorded.reference import with_scored_region
from trackbench.truth.row_times import nearest_rows, row_period
from trackbench.truth.tracks import (
    LONGEST_GAP_S,
    SAME_STAMP_S,
    TRAFFIC_FORMATS,
    TrackRows,
    TrafficTrack,
    read_rows,
    tracks_of_rows,
)

#: Instants times objects that still fit the memory of a small machine.
LARGEST = 20_000_000


def load_boxes(config: BoxesOptions, folder: Path, *, sensors: bool) -> Truth:
    """Return the truth that boxes are.

    Args:
        config: the ``truth`` of a scenario.
        folder: where relative paths start.
        sensors: whether the scenario has sensors, which stand at the observer.

    Raises:
        InputError: the file cannot be read or is damaged, or has no object.
    """
    file = find_log(config.path, folder, "truth.path")
    rows = read_rows(config.format, file)
    dont_care = np.zeros(len(rows), dtype=bool) if rows.dont_care is None else rows.dont_care
    if dont_care.all():
        raise InputError("every row is a don't-care box, so there is no object", file=file)
    time = _without_rounding(rows.time)
    first = float(time[~dont_care].min())
    tracks = tracks_of_rows(_only(rows, time - first, ~dont_care), file)
    if len(np.unique(time)) * len(tracks) > LARGEST:
        what = f"{counted(len(tracks), 'object')} at {len(np.unique(time))} times"
        raise InputError(f"{what} are too many; take a shorter time", file=file)
    kinds = {track.id: track.kind for track in tracks}
    for number, kind in enumerate(config.reference.classes or ()):
        if kind.casefold() not in {each.casefold() for each in kinds.values()}:
            classes = ", ".join(sorted({*kinds.values()} - {""})) or "no classes"
            raise InputError(
                f"no object is of the class {kind!r}; the file has {classes}", key=f"truth.reference.classes.{number}"
            )
    drive = Drive(
        {track.id: _motion(track) for track in tracks},
        RowOrder(len(rows), 0, 0.0, 0),
        observer=None,
        logs={},
        source={
            "source": "recorded-boxes",
            "format": TRAFFIC_FORMATS.name_of(type(config.format)),
            "file": file.name,
            "rows": len(rows),
        },
        frames=np.unique(time) - first,
        boxes=_boxes(_only(rows, time - first, dont_care)),
        kinds=kinds,
        start=rows.start + Decimal(repr(first)),
    )
    if not config.has_observer and not sensors:
        # Nothing is measured from there: it is where the pictures look from.
        middle = FixedObserver(x=float(np.round(rows.px.mean())), y=float(np.round(rows.py.mean())))
        config = config.model_copy(update={"observer": middle})
    truth = with_scored_region(truth_on_grid(config, drive, grid(drive, {})), config.reference, drive)
    beside = _beside(drive, truth) & ~truth.alive
    truth = replace(truth, alive=truth.alive | beside, beside=beside)
    if config.stretches is not None:
        require_long_enough(truth, {}, config.stretches)
    return truth


def _without_rounding(time: Array) -> Array:
    """The times, those that differ by rounding alone made equal to the earliest of them."""
    order = np.argsort(time, kind="stable")
    begins = np.diff(time[order], prepend=-np.inf) > SAME_STAMP_S
    result = np.empty_like(time)
    result[order] = time[order][np.flatnonzero(begins)[np.cumsum(begins) - 1]]
    return result


def _only(rows: TrackRows, time: Array, chosen: Mask) -> TrackRows:
    return replace(rows, time=time, start=Decimal(0)).rows(np.flatnonzero(chosen))


def _motion(track: TrafficTrack) -> Motion:
    """As stated; without a velocity that of the displacement."""
    vx, vy = track.vx, track.vy
    if vx is None or vy is None:
        vx, vy = slope(track.x, track.time), slope(track.y, track.time)
    length, width = (None if size is None else np.array([size]) for size in (track.length, track.width))
    return Motion(track.time, track.x, track.y, vx, vy, track.heading, length=length, width=width)


def _beside(drive: Drive, truth: Truth) -> Mask:
    """``(steps, objects)`` which times, of other objects, are near a row or between two with none missing between."""
    usual = [float(np.median(np.diff(own.time))) for own in drive.motions.values() if len(own.time) > 1]
    result = np.zeros_like(truth.alive)
    for number, own in enumerate(drive.motions.values()):
        period, whole = row_period(own.time)
        period = min(period or float(np.median(usual or [0.0])), LONGEST_GAP_S)
        _, away, before = nearest_rows(own.time, truth.time)
        inside = (truth.time > own.time[0]) & (truth.time < own.time[-1])
        between = inside & np.append(whole & (np.diff(own.time) <= LONGEST_GAP_S), False)[before]
        result[:, number] = between | (away <= period / 2 * (1 + 1e-9))
    return result


def _boxes(rows: TrackRows) -> Array:
    """Don't-care boxes as in ``Drive.boxes``; a point where the file does not state a size."""
    heading, length, width = (
        np.zeros(len(rows)) if values is None else np.nan_to_num(values)
        for values in (rows.heading, rows.length, rows.width)
    )
    halves = (np.maximum(size, 0.0) / 2 for size in (length, width))
    return np.stack([rows.time, rows.px, rows.py, heading, *halves])
