"""Recorded tracks on a regular grid of times, smoothed, and what smoothing took away."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, RecordedNoise
from trackbench.truth.config.traffic import Smoothing
from trackbench.truth.tracks import TrafficTrack, longest_gap

#: Slower than this a displacement has no direction that could be a heading, m/s.
SLOW_MPS = 0.5


class GridTrack(NamedTuple):
    """The motion of one track at the times ``first * dt``, ``(first + 1) * dt``, ..."""

    track: TrafficTrack
    first: int
    """Number of the grid's instant at which it begins."""
    x: Array
    """``(steps,)`` m."""
    y: Array
    """``(steps,)`` m."""
    vx: Array
    """``(steps,)`` m/s."""
    vy: Array
    """``(steps,)`` m/s."""
    heading: Array
    """``(steps,)`` rad."""
    raw_x: Array
    """``(steps,)`` m, as recorded."""
    raw_y: Array
    """``(steps,)`` m, as recorded."""
    raw_speed: Array
    """``(steps,)`` m/s, as the file states it; where it does not, from the displacement."""


def grid_step(tracks: Sequence[TrafficTrack]) -> float:
    """The time between two rows of a track, s: the median."""
    return float(np.median(np.concatenate([np.diff(track.time) for track in tracks])))


def grid_tracks(tracks: Sequence[TrafficTrack], dt: float, smoothing: Smoothing | None) -> list[GridTrack]:
    """The tracks on one grid of times, without those that have fewer than two of its instants.

    Between rows they are interpolated linearly, which changes nothing where the rows lie on the grid.

    Args:
        tracks: each with at least two rows.
        dt: the grid's step, s.
        smoothing: None: positions and speeds as recorded.
    """
    result = []
    for track in tracks:
        for part in _without_gaps(track, dt):
            # Rows are on the grid but for rounding of their times.
            first, last = int(np.ceil(part.time[0] / dt - 0.05)), int(np.floor(part.time[-1] / dt + 0.05))
            if last > first:
                result.append(_on_grid(part, first, np.arange(first, last + 1, dtype=np.float64) * dt, dt, smoothing))
    return result


def _without_gaps(track: TrafficTrack, dt: float) -> Iterator[TrafficTrack]:
    begins = np.flatnonzero(np.diff(track.time) > longest_gap(dt)) + 1
    edges = [0, *begins.tolist(), len(track.time)]
    for number, (start, end) in enumerate(pairwise(edges), 1):
        arrays = {
            key: values[start:end]
            for key in ("time", "x", "y", "heading", "speed")
            if (values := getattr(track, key)) is not None
        }
        name = track.id if number == 1 else f"{track.id} ({number})"
        yield track._replace(id=name, **arrays)


def _on_grid(track: TrafficTrack, first: int, times: Array, dt: float, smoothing: Smoothing | None) -> GridTrack:
    def at(values: Array) -> Array:
        return np.interp(times, track.time, values)

    raw_x, raw_y = at(track.x), at(track.y)
    raw_vx, raw_vy = np.gradient(raw_x, dt), np.gradient(raw_y, dt)
    raw_speed = np.hypot(raw_vx, raw_vy) if track.speed is None else at(track.speed)
    x, y, vx, vy = raw_x, raw_y, raw_vx, raw_vy
    if smoothing is not None:
        (x, vx), (y, vy) = (smoothed(values, dt, smoothing) for values in (raw_x, raw_y))
    course = _course(vx, vy)
    heading = course if track.heading is None else at(np.unwrap(track.heading))
    if smoothing is not None and track.heading is not None:
        heading = smoothed(heading, dt, smoothing)[0]
    if smoothing is None and track.speed is not None:
        # As recorded: the file's speed along the body, backwards where it moves so.
        along = course if track.heading is None else heading
        vx, vy = raw_speed * np.cos(along), raw_speed * np.sin(along)
    return GridTrack(track, first, x, y, vx, vy, heading, raw_x, raw_y, raw_speed)


def _course(vx: Array, vy: Array) -> Array:
    """``(steps,)`` direction of motion, rad; while a body is slow, that of the nearest instant before, else after; 0 of
    one that is always slow, whose displacement is noise."""
    moving = np.hypot(vx, vy) > SLOW_MPS
    if not moving.any():
        return np.zeros(len(vx))
    steps = np.arange(len(vx))
    latest = np.maximum.accumulate(np.where(moving, steps, -1))
    chosen = np.where(latest < 0, int(np.argmax(moving)), latest)
    return np.asarray(np.unwrap(np.arctan2(vy, vx)[chosen]))


def smoothed(values: Array, dt: float, smoothing: Smoothing) -> tuple[Array, Array]:
    """Position and velocity, ``(steps,)`` each, from positions along one axis.

    The velocity at an instant is the slope of the polynomial of its window; within half a window of the ends it is the
    slope of the first or last window's polynomial there. A track shorter than the window has one polynomial. The
    position is the integral of the velocity by the trapezoid, with the mean of the recorded positions.

    Source of the slopes: Savitzky and Golay (1964), "Smoothing and differentiation of data by simplified least squares
    procedures". With the order 2 the position so is the mean of those recorded, weighted by a parabola over the window.
    """
    steps = len(values)
    size = min(2 * round((smoothing.window_s / dt - 1) / 2) + 1, steps)
    order = min(smoothing.order, size - 1)
    half = size // 2
    windows = np.lib.stride_tricks.sliding_window_view(values, size)
    coefficients = windows @ _least_squares(size, order, dt)
    window = np.clip(np.arange(steps) - half, 0, steps - size)
    offset = (np.arange(steps) - half - window) * dt
    velocity = sum(k * coefficients[window, k] * offset ** (k - 1) for k in range(1, order + 1)) + np.zeros(steps)
    position = np.concatenate([[0.0], np.cumsum((velocity[1:] + velocity[:-1]) * (dt / 2))])
    return position + np.mean(values - position), velocity


@lru_cache
def _least_squares(size: int, order: int, dt: float) -> Array:
    """``(size, order + 1)`` what a window's values are multiplied by to give the coefficients of its polynomial."""
    powers = np.vander((np.arange(size) - size // 2) * dt, order + 1, increasing=True)
    return np.asarray(np.linalg.pinv(powers).T)


def recorded_noise(tracks: Sequence[GridTrack]) -> RecordedNoise:
    """Return the root mean square of what smoothing took from the positions per axis, and from the speeds."""
    shift = np.concatenate([np.concatenate([t.raw_x - t.x, t.raw_y - t.y]) for t in tracks])
    change = np.concatenate([t.raw_speed - np.hypot(t.vx, t.vy) for t in tracks])
    return RecordedNoise(float(np.sqrt(np.mean(shift**2))), float(np.sqrt(np.mean(change**2))))
