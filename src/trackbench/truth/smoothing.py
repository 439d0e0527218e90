"""Recorded tracks on a regular grid of times, with smoothing and its residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, RecordedNoise
from trackbench.truth.config.traffic import Smoothing
from trackbench.truth.tracks import TrafficTrack, longest_gap

#: Speed below which the direction of a displacement is no heading, m/s.
SLOW_MPS = 0.5


class GridTrack(NamedTuple):
    """Motion of one track, arrays ``(steps,)``, at the times ``first * dt``, ``(first + 1) * dt``, ..."""

    track: TrafficTrack
    first: int
    """Index of the grid's instant at which the track begins."""
    x: Array
    y: Array
    vx: Array
    vy: Array
    heading: Array
    """``(steps,)`` heading, rad, unwrapped; the direction of motion if none is stated."""
    raw_x: Array
    """``(steps,)`` x as recorded, before smoothing, m."""
    raw_y: Array
    """``(steps,)`` y as recorded, before smoothing, m."""
    raw_speed: Array
    """``(steps,)`` speed before smoothing, m/s: as stated in the file, else from the displacement."""


def grid_step(tracks: Sequence[TrafficTrack]) -> float:
    """Return the median time between neighbouring rows of all tracks, s."""
    return float(np.median(np.concatenate([np.diff(track.time) for track in tracks])))


def grid_tracks(tracks: Sequence[TrafficTrack], dt: float, smoothing: Smoothing | None) -> list[GridTrack]:
    """Return the tracks on one regular grid of times; tracks with fewer than two instants on it are left out.

    Tracks are interpolated linearly between rows, which leaves rows on the grid unchanged.

    Args:
        tracks: tracks with at least two rows each.
        dt: step of the grid, s.
        smoothing: options of the smoothing; None to keep positions and speeds as recorded.
    """
    result = []
    for track in tracks:
        for part in _without_gaps(track, dt):
            # Rows are on the grid up to the rounding of their times.
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
        # As recorded: the file's speed along the body, which is negative in reverse.
        along = course if track.heading is None else heading
        vx, vy = raw_speed * np.cos(along), raw_speed * np.sin(along)
    return GridTrack(track, first, x, y, vx, vy, heading, raw_x, raw_y, raw_speed)


def _course(vx: Array, vy: Array) -> Array:
    """Return the direction of motion, ``(steps,)`` rad, held while the body is slow; 0 if it is always slow."""
    is_moving = np.hypot(vx, vy) > SLOW_MPS
    if not is_moving.any():
        return np.zeros(len(vx))
    steps = np.arange(len(vx))
    latest = np.maximum.accumulate(np.where(is_moving, steps, -1))
    chosen = np.where(latest < 0, int(np.argmax(is_moving)), latest)
    return np.asarray(np.unwrap(np.arctan2(vy, vx)[chosen]))


def smoothed(values: Array, dt: float, smoothing: Smoothing) -> tuple[Array, Array]:
    """Return smoothed position and velocity, ``(steps,)`` each, from recorded positions along one axis.

    The velocity at an instant is the slope of the polynomial through its window. Within half a window of the ends, the
    first or last window's polynomial is used. A track shorter than the window has one polynomial. The position is the
    integral of the velocity by the trapezoidal rule, with the mean of the recorded positions. With order 2 it equals
    the mean of the recorded positions in the window, weighted by a parabola.

    Source of the slopes: Savitzky and Golay (1964), "Smoothing and differentiation of data by simplified least squares
    procedures".
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
    """Return the matrix ``(size, order + 1)`` that maps the values in a window to polynomial coefficients."""
    powers = np.vander((np.arange(size) - size // 2) * dt, order + 1, increasing=True)
    return np.asarray(np.linalg.pinv(powers).T)


def recorded_noise(tracks: Sequence[GridTrack]) -> RecordedNoise:
    """Return the RMS change by the smoothing of positions, per axis, and of speeds."""
    shift = np.concatenate([np.concatenate([t.raw_x - t.x, t.raw_y - t.y]) for t in tracks])
    change = np.concatenate([t.raw_speed - np.hypot(t.vx, t.vy) for t in tracks])
    return RecordedNoise(float(np.sqrt(np.mean(shift**2))), float(np.sqrt(np.mean(change**2))))
