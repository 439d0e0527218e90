"""What of a recorded truth counts where tracks are scored: its boxes, classes, region and gaps, and its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackbench.base.types import Array, Indices, Mask, Truth, Unscored
from trackbench.base.units import wrap_angle
from trackbench.truth.config.columns import ReferenceOptions
from trackbench.truth.recorded.drive import Drive, Motion, slope
from trackbench.truth.recorded.robust import noise_of_motions
from trackbench.truth.tracks import longest_gap


def moved_ahead(motion: Motion, heading: Array, ahead: Array | float) -> Motion:
    """Return the motion of a point ``ahead`` m in front of the body's own, along ``heading`` ``(rows,)`` rad."""
    heading = np.unwrap(heading)
    turning = slope(heading, motion.time) if motion.yaw_rate is None else motion.yaw_rate
    x, y = ahead * np.cos(heading), ahead * np.sin(heading)
    return motion._replace(px=motion.px + x, py=motion.py + y, vx=motion.vx - turning * y, vy=motion.vy + turning * x)


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
    unscored = None
    ignored = reference.others is not None
    if reference.range_m is not None or drive.boxes.size or ignored:
        limit = np.inf if reference.range_m is None else reference.range_m
        unscored = Unscored(limit, _lasting(drive.boxes, drive.frames), ignored)
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
