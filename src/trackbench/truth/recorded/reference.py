"""Which parts of a recorded truth are scored (boxes, classes, region, gaps), and its noise."""

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
    """Return the motion of a point ``ahead`` m in front of the body's position, along ``heading`` ``(rows,)``."""
    heading = np.unwrap(heading)
    turning = slope(heading, motion.time) if motion.yaw_rate is None else motion.yaw_rate
    x, y = ahead * np.cos(heading), ahead * np.sin(heading)
    return motion._replace(px=motion.px + x, py=motion.py + y, vx=motion.vx - turning * y, vy=motion.vy + turning * x)


def with_scored_region(truth: Truth, reference: ReferenceOptions, drive: Drive) -> Truth:
    """Return the truth, marked with the objects and regions that are scored, gaps between rows, and its noise."""
    kinds = drive.kinds
    alive = truth.alive.copy()
    for number, motion in enumerate(drive.motions.values()):
        alive[:, number] &= ~_in_gap(motion.time, truth.time)
    target = truth.target
    if reference.classes is not None:
        counted = {kind.casefold() for kind in reference.classes}
        target = np.array([kinds.get(name, "").casefold() in counted for name in truth.ids])
    unscored = None
    ignores_others = reference.others is not None
    if reference.range_m is not None or drive.boxes.size or ignores_others:
        limit = np.inf if reference.range_m is None else reference.range_m
        unscored = Unscored(limit, _lasting(drive.boxes, drive.frames), ignores_others)
    noise = noise_of_motions(drive.motions.values())
    source = {**truth.source, "recorded_noise": noise._asdict(), **({"others": "ignored"} if ignores_others else {})}
    return replace(truth, alive=alive, target=target, unscored=unscored, recorded_noise=noise, source=source)


def _in_gap(rows: Array, time: Array) -> Mask:
    steps = np.diff(rows)
    if not len(steps):
        return np.zeros(len(time), dtype=bool)
    after = np.clip(np.searchsorted(rows, time), 1, len(rows) - 1)
    between = (time > rows[after - 1]) & (time < rows[after])
    return np.asarray(between & (steps[after - 1] > longest_gap(float(np.median(steps)))))


def _lasting(boxes: Array, frames: Array) -> Array:
    """Return don't-care boxes ``(7, boxes)`` with start and end: half way to the previous and next frame."""
    frame: Indices = np.searchsorted(frames, boxes[0])
    steps = np.diff(frames)
    usual_step = float(np.median(steps)) if len(steps) else 0.0
    half = np.minimum(np.concatenate([[usual_step], steps, [usual_step]]), longest_gap(usual_step)) / 2
    x, y, heading = boxes[1:4]
    return np.stack([boxes[0] - half[frame], boxes[0] + half[frame + 1], x, y, wrap_angle(heading), *boxes[4:]])
