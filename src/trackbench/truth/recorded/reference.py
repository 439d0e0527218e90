"""What of a recorded truth counts where tracks are scored: its boxes, classes, region and gaps, and its noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trackbench.base.numbers import stated_number
from trackbench.base.types import Array, Indices, Mask, Truth, Unscored
from trackbench.base.units import wrap_angle
from trackbench.truth.config.columns import BoxRegion, ReferenceOptions, TruthColumns
from trackbench.truth.config.recording import RecordingOptions, ReferenceTruth
from trackbench.truth.recorded.drive import Drive, Motion, slope
from trackbench.truth.recorded.robust import noise_of_motions
from trackbench.truth.recorded.rows import Rows
from trackbench.truth.tracks import longest_gap

#: Of a box, m.
LARGEST_M = 1000.0


def ignored_rows(table: Rows, ignore: Mapping[str, Sequence[str]]) -> Mask:
    """Return ``(rows,)`` which rows are don't-care boxes: by column, the values that make them so."""
    result = np.zeros(len(table), dtype=bool)
    for column, values in ignore.items():
        words = {value.casefold() for value in values}
        numbers = {number for value in values if math.isfinite(number := stated_number(value))}
        cells = table.texts(column)
        is_ignored = {cell: cell.casefold() in words or stated_number(cell) in numbers for cell in {*cells}}
        result |= np.array([is_ignored[cell] for cell in cells])
    return result


def moved_to_centre(motion: Motion, config: ReferenceTruth) -> Motion:
    """The motion of the centre of a box, from that of the point that the reference has."""
    ahead = _to_centre(config.reference, config.length_m if motion.length is None else motion.length)
    return motion if motion.heading is None or not np.any(ahead) else moved_ahead(motion, motion.heading, ahead)


def moved_ahead(motion: Motion, heading: Array, ahead: Array | float) -> Motion:
    """Return the motion of a point ``ahead`` m in front of the body's own, along ``heading`` ``(rows,)`` rad."""
    heading = np.unwrap(heading)
    turning = slope(heading, motion.time) if motion.yaw_rate is None else motion.yaw_rate
    x, y = ahead * np.cos(heading), ahead * np.sin(heading)
    return motion._replace(px=motion.px + x, py=motion.py + y, vx=motion.vx - turning * y, vy=motion.vy + turning * x)


def _to_centre(reference: ReferenceOptions, length: Array | float) -> Array:
    """How far the centre is ahead of the reference's point, m."""
    if reference.point in (None, "centre"):
        return np.zeros(np.shape(length))
    return np.asarray(length) / 2


def dont_care_boxes(table: Rows, columns: TruthColumns, seconds: Array, config: RecordingOptions) -> Array:
    """``(6, boxes)`` as in ``Drive.boxes``; rows without a place or a size are of none."""

    def column(key: str, quantity: str, otherwise: float) -> Array:
        name = getattr(columns, key)
        if name is None:
            return np.full(len(table), otherwise)
        return table.numbers(name, config.units.factor(quantity, columns.units.get(key)), quantity, optional=True)

    x, y = column("px", "length", 0.0), column("py", "length", 0.0)
    heading, length = column("heading", "angle", 0.0), column("length", "length", config.length_m)
    boxes = placed_boxes(seconds, x, y, heading, length, column("width", "length", config.width_m), config.reference)
    return np.asarray(boxes[:, np.isfinite(boxes).all(axis=0) & (boxes[4:] > 0).all(axis=0)])


def placed_boxes(
    seconds: Array, x: Array, y: Array, heading: Array, length: Array, width: Array, reference: ReferenceOptions
) -> Array:
    """``(6, boxes)`` as in ``Drive.boxes``, from the point that the reference has."""
    ahead = _to_centre(reference, length)
    centre = x + ahead * np.cos(heading), y + ahead * np.sin(heading)
    return np.stack([seconds, *centre, heading, length / 2, width / 2])


def with_scored_region(truth: Truth, reference: ReferenceOptions, drive: Drive) -> Truth:
    """The truth of hidden identities: which objects count and where, while they have rows, and its noise."""
    kinds = drive.kinds
    alive = truth.alive.copy()
    for number, motion in enumerate(drive.motions.values()):
        alive[:, number] &= ~_in_gap(motion.time, truth.time)
    target = truth.target
    if reference.classes is not None:
        counted = {kind.casefold() for kind in reference.classes}
        target = np.array([kinds.get(name, "").casefold() in counted for name in truth.ids])
    region = reference.region
    if isinstance(region, BoxRegion):
        (x, right), (y, top) = region.x_m, region.y_m
        region = [[x, y], [right, y], [right, top], [x, top]]
    unscored = None
    ignored = reference.others is not None
    if region is not None or reference.range_m is not None or drive.boxes.size or ignored:
        limit = np.inf if reference.range_m is None else reference.range_m
        corners = None if region is None else np.array(region, dtype=float)
        unscored = Unscored(corners, limit, _lasting(drive.boxes, drive.frames), ignored)
    noise = noise_of_motions(drive.motions.values())
    source = {**truth.source, "recorded_noise": noise._asdict(), **({"others": "ignored"} if ignored else {})}
    return replace(truth, alive=alive, target=target, unscored=unscored, recorded_noise=noise, source=source)


def _in_gap(rows: Array, time: Array) -> Mask:
    """``(steps,)`` whether a time is in a gap between rows, where its object is absent."""
    steps = np.diff(rows)
    if not len(steps):
        return np.zeros(len(time), dtype=bool)
    after = np.clip(np.searchsorted(rows, time), 1, len(rows) - 1)
    between = (time > rows[after - 1]) & (time < rows[after])
    return np.asarray(between & (steps[after - 1] > longest_gap(float(np.median(steps)))))


def _lasting(boxes: Array, frames: Array) -> Array:
    """``(7, boxes)`` as in ``Unscored.boxes``: each until half way to the rows before and after, but no gap long."""
    number: Indices = np.searchsorted(frames, boxes[0])
    steps = np.diff(frames)
    usual = float(np.median(steps)) if len(steps) else 0.0
    half = np.minimum(np.concatenate([[usual], steps, [usual]]), longest_gap(usual)) / 2
    x, y, heading = boxes[1:4]
    return np.stack([boxes[0] - half[number], boxes[0] + half[number + 1], x, y, wrap_angle(heading), *boxes[4:]])
