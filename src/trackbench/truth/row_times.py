"""The period of the rows of a track, and where rows are missing, also where time stamps jitter."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices, Mask

#: Rows whose period is found together: clocks drift, and a periodogram of fewer does not show a jitter of 40 %.
TOGETHER = 1000
#: A gap of more median steps divides the rows, too.
FAR = 20.0
#: Bins of a median step in which time stamps are counted.
BINS = 32
#: Power from which a period stands out. Of stamps without a period it is distributed as Exp(1) at each frequency.
CLEAR = 10.0
#: By how much the power must be larger at a frequency that is not that of the median step: multiples of it have some.
LARGER = 1.5


def row_period(stamp: Array) -> tuple[float, Mask]:
    """Return the period of the rows of one body, and which gaps between them lack no row.

    Stamps may jitter about their frames by less than half a period. The period is the peak of the periodogram of the
    stamps (Schuster 1898, "On the investigation of hidden periodicities"), and a gap lacks no row where it leads from
    one frame to the next. Where no period stands out, it is the median step, and a gap lacks no row up to 1.5 of it.

    Args:
        stamp: ``(rows,)`` s, ascending.

    Returns:
        The period, s, 0 of a single row, and a mask ``(rows - 1,)``.
    """
    steps = np.diff(stamp)
    if not len(steps):
        return 0.0, np.zeros(0, dtype=bool)
    usual = float(np.median(steps))
    whole = steps <= 1.5 * usual
    periods = [usual]
    if not usual or (np.abs(steps / usual - np.round(steps / usual)) < 0.25).all():
        return usual, whole
    part = np.concatenate([[0], np.cumsum(steps > FAR * usual)])
    part = part * len(stamp) + np.arange(len(stamp)) // TOGETHER
    for first, last in _runs(part):
        own = slice(first, min(last + 1, len(stamp)))
        period, frames = _frames(stamp[own] - stamp[first], usual, max(float(np.percentile(steps, 10)), usual / 8))
        if frames is not None:
            whole[first : own.stop - 1] = np.diff(frames) <= 1
            periods.append(period)
    return float(np.median(periods[1:] or periods)), whole


def nearest_rows(stamp: Array, time: Array) -> tuple[Indices, Array, Indices]:
    """Return for each time the nearest row, the earlier of two as near, how far it is, s, and the row before.

    Args:
        stamp: ``(rows,)`` s, ascending.
        time: ``(times,)`` s.
    """
    after = np.clip(np.searchsorted(stamp, time), 0, len(stamp) - 1)
    before = np.maximum(after - 1, 0)
    away = np.abs(stamp[[before, after]] - time)
    return np.where(away[0] <= away[1], before, after), away.min(axis=0), before


def _runs(part: Array) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(part)) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(part)], strict=True))


def _frames(stamp: Array, usual: float, least: float) -> tuple[float, Array | None]:
    """Return the period of stamps from 0 on, and the number of the frame of each; None where none stands out."""
    counts = np.bincount(np.round(stamp * BINS / usual).astype(np.intp))
    length = 1 << (4 * len(counts)).bit_length()
    frequency = np.arange(length // 2 + 1) * BINS / (usual * length)
    power = np.abs(np.fft.rfft(counts, length)) ** 2 / len(stamp)
    power[(frequency < 0.85 / usual) | (frequency > 1.15 / least)] = 0.0
    power[frequency > 1.15 / usual] /= LARGER
    if not power.max() > CLEAR:
        return usual, None
    best = float(frequency[np.argmax(power)])
    phase = np.angle(np.exp(2j * np.pi * best * stamp).sum()) / (2 * np.pi)
    return 1.0 / best, np.round(stamp * best - phase)
