"""Ground truth from reference boxes in a file, neither repaired nor thinned out."""

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

#: Largest number of instants times objects that fits the memory of a small machine.
LARGEST = 20_000_000


def load_boxes(config: BoxesOptions, folder: Path, *, sensors: bool) -> Truth:
    """Return the ground truth that the reference boxes of a file state.

    Args:
        config: the scenario's ``truth``.
        folder: folder where relative paths start.
        sensors: whether the scenario has sensors; they are at the observer.

    Raises:
        InputError: the file cannot be read, is damaged, or has no object.
    """
    file = find_log(config.path, folder, "truth.path")
    rows = read_rows(config.format, file)
    dont_care = np.zeros(len(rows), dtype=bool) if rows.dont_care is None else rows.dont_care
    if dont_care.all():
        raise InputError("every row is a don't-care box, so there is no object", file=file)
    time = _without_rounding(rows.time)
    first = float(time[~dont_care].min())
    tracks = tracks_of_rows(_selected_rows(rows, time - first, ~dont_care), file)
    if len(np.unique(time)) * len(tracks) > LARGEST:
        what = f"{counted(len(tracks), 'object')} at {len(np.unique(time))} times"
        raise InputError(f"{what} are too many; take a shorter time", file=file)
    kinds = {track.id: track.kind for track in tracks}
    for kind in config.reference.classes or ():
        if kind.casefold() not in {class_name.casefold() for class_name in kinds.values()}:
            classes = ", ".join(sorted({*kinds.values()} - {""})) or "no classes"
            message = f"no object is of the class {kind!r}; the file has {classes}"
            raise InputError(message, key="truth.reference.classes")
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
        boxes=_dont_care_boxes(_selected_rows(rows, time - first, dont_care)),
        kinds=kinds,
        start=rows.start + Decimal(repr(first)),
    )
    if not config.has_observer and not sensors:
        # Without sensors the observer is only the centre of the pictures.
        middle = FixedObserver(x=float(np.round(rows.px.mean())), y=float(np.round(rows.py.mean())))
        config = config.model_copy(update={"observer": middle})
    truth = with_scored_region(truth_on_grid(config, drive, grid(drive, {})), config.reference, drive)
    beside = _is_near_row(drive, truth) & ~truth.alive
    truth = replace(truth, alive=truth.alive | beside, beside=beside)
    if config.stretches is not None:
        require_long_enough(truth, {}, config.stretches)
    return truth


def _without_rounding(time: Array) -> Array:
    """Return the times, where times that differ only by rounding are set to the earliest one."""
    order = np.argsort(time, kind="stable")
    is_new = np.diff(time[order], prepend=-np.inf) > SAME_STAMP_S
    result = np.empty_like(time)
    result[order] = time[order][np.flatnonzero(is_new)[np.cumsum(is_new) - 1]]
    return result


def _selected_rows(rows: TrackRows, time: Array, is_selected: Mask) -> TrackRows:
    return replace(rows, time=time, start=Decimal(0)).rows(np.flatnonzero(is_selected))


def _motion(track: TrafficTrack) -> Motion:
    """Return the stated motion of a track; a missing velocity is taken from the displacement."""
    vx, vy = track.vx, track.vy
    if vx is None or vy is None:
        vx, vy = slope(track.x, track.time), slope(track.y, track.time)
    length, width = (None if size is None else np.array([size]) for size in (track.length, track.width))
    return Motion(track.time, track.x, track.y, vx, vy, track.heading, length=length, width=width)


def _is_near_row(drive: Drive, truth: Truth) -> Mask:
    """Return which times are near a row of an object, or between rows without a gap, ``(steps, objects)``."""
    periods = [float(np.median(np.diff(motion.time))) for motion in drive.motions.values() if len(motion.time) > 1]
    result = np.zeros_like(truth.alive)
    for number, motion in enumerate(drive.motions.values()):
        period, has_no_gap = row_period(motion.time)
        period = min(period or float(np.median(periods or [0.0])), LONGEST_GAP_S)
        _, distance, before = nearest_rows(motion.time, truth.time)
        is_inside = (truth.time > motion.time[0]) & (truth.time < motion.time[-1])
        is_between = is_inside & np.append(has_no_gap & (np.diff(motion.time) <= LONGEST_GAP_S), False)[before]
        result[:, number] = is_between | (distance <= period / 2 * (1 + 1e-9))
    return result


def _dont_care_boxes(rows: TrackRows) -> Array:
    heading, length, width = (
        np.zeros(len(rows)) if values is None else np.nan_to_num(values)
        for values in (rows.heading, rows.length, rows.width)
    )
    halves = (np.maximum(size, 0.0) / 2 for size in (length, width))
    return np.stack([rows.time, rows.px, rows.py, heading, *halves])
