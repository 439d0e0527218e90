"""The sizes of acceleration and wander of ``human`` at which simulated drivers vary as recorded ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.truth.drivers import HUMAN, Drivers

from . import statistics
from .recorded import Window
from .simulated import congested


class Effect(NamedTuple):
    """One of the two processes: its keys in the options, and the statistics that the fit makes alike."""

    size: str
    time: str
    alike: tuple[str, ...]
    """The first is met exactly for each correlation time; the others tell how well the time does."""


EFFECTS = (
    Effect("acceleration_rms_mps2", "acceleration_time_s", ("rms", "median", "p90", "p99", "small", "time")),
    Effect("wander_m", "wander_time_s", ("side", "side_speed")),
)
#: Sizes that are simulated, over those of ``human``. A logarithm of a statistic is taken as a straight line in that of
#: the size, between them and beyond.
SIMULATED = (1.0, 1.5)
#: Speeds from which on the acceleration has its full size that are tried beside that of ``human``, m/s.
OTHER_FULL_MPS = (2.0, 6.0, 8.0, 12.0, 15.0)
#: Correlation times that are tried beside those of ``human``, over these.
OTHER_TIMES = (0.25, 0.5, 2.0, 4.0)
#: Of each leader: at the times of ``human``, and at the others.
SEEDS, FEWER_SEEDS = 8, 2
#: Draws of vehicles and of seeds for an interval.
DRAWS = 2000
#: Edges of the ranges of the mean speed of a window, m/s.
SPEEDS_MPS = (0, 4, 6, 8, 10, 20)

Lanes = list[list[Window]]
"""The windows of each lane, the leaders of the first seed first."""


class Trial(NamedTuple):
    """A correlation time or speed, the size that it takes, and how far off the statistics are."""

    value: float
    size: float
    off: float
    """RMS of the logarithms of simulated over recorded statistics."""


class Size(NamedTuple):
    """The size of the acceleration that meets the recorded RMS, m/s^2, and its 95 % interval."""

    value: float
    least: float
    most: float


def simulated(slower: float, speeds: Sequence[float], seeds: int, drivers: Drivers = HUMAN) -> tuple[Lanes, Lanes]:
    """Lanes of both of the sizes ``SIMULATED``, with the correlation times of ``drivers`` times ``slower``.

    The effects are fitted in the same simulations: nobody accelerates for the sake of a place in the lane.
    """
    low, high = (
        congested(
            replace(
                drivers,
                **{effect.size: getattr(drivers, effect.size) * times for effect in EFFECTS},
                **{effect.time: getattr(drivers, effect.time) * slower for effect in EFFECTS},
            ),
            speeds,
            range(1, seeds + 1),
        )
        for times in SIMULATED
    )
    return low, high


def with_full_size_at(speed_mps: float) -> Drivers:
    """Drivers as ``human``, whose acceleration has its full size from another speed on; below, it grows as theirs."""
    size = HUMAN.acceleration_rms_mps2 * speed_mps / HUMAN.acceleration_full_mps
    return replace(HUMAN, acceleration_rms_mps2=size, acceleration_full_mps=speed_mps)


def full_size_trial(drivers: Drivers, recorded: Sequence[Window], lanes: tuple[Lanes, Lanes]) -> Trial:
    """The size that is nearest to the recorded RMS in all ranges of ``SPEEDS_MPS``, each as often as it has vehicles.

    The slowest range is left out: there recorded drivers hold the pedal still, which no size does.
    """
    wanted = _sums([[window] for window in recorded]).sum(axis=0)[2:]
    low, high = (_sums([[window for lane in of for window in lane]])[0, 2:] for of in lanes)
    least, most, met = (np.log(squares / number) / 2 for number, squares in (low.T, high.T, wanted.T))
    weight = wanted[:, 0] / wanted[:, 0].sum()
    slope = most - least
    along = float(weight @ (slope * (met - least)) / (weight @ slope**2))
    size = drivers.acceleration_rms_mps2 * (SIMULATED[1] / SIMULATED[0]) ** along
    off = least + along * slope - met
    return Trial(drivers.acceleration_full_mps, size, float(np.sqrt(weight @ off**2)))


def trials(slower: float, recorded: Sequence[Window], lanes: tuple[Lanes, Lanes]) -> list[Trial]:
    """Of each effect, how it does with this correlation time."""
    wanted = statistics.of(recorded)
    low, high = (statistics.of([window for lane in of for window in lane]) for of in lanes)
    return [_trial(effect, slower * getattr(HUMAN, effect.time), wanted, low, high) for effect in EFFECTS]


def _trial(
    effect: Effect, time_s: float, wanted: Mapping[str, float], low: Mapping[str, float], high: Mapping[str, float]
) -> Trial:
    met = effect.alike[0]
    along = math.log(wanted[met] / low[met]) / math.log(high[met] / low[met])
    off = [math.log(low[key] / wanted[key]) + along * math.log(high[key] / low[key]) for key in effect.alike]
    size = getattr(HUMAN, effect.size) * (SIMULATED[1] / SIMULATED[0]) ** along
    return Trial(time_s, size, math.sqrt(sum(each**2 for each in off) / len(off)))


def sizes(recorded: Sequence[Window], lanes: tuple[Lanes, Lanes], leaders: int) -> list[Size]:
    """For all speeds together and for each range of ``SPEEDS_MPS``: the size that meets the recorded RMS.

    For the interval vehicles are drawn again, and of each leader the seeds.
    """
    random = np.random.default_rng(1)
    vehicles, seeds = len(recorded), len(lanes[0]) // leaders
    every = np.arange(seeds * leaders)
    seen = np.vstack([np.arange(vehicles), random.integers(vehicles, size=(DRAWS, vehicles))])
    driven = np.vstack(
        [every, random.integers(seeds, size=(DRAWS, len(every))) * leaders + every % leaders],
    )
    wanted = _log_rms(_sums([[window] for window in recorded])[seen])
    low, high = (_log_rms(_sums(of)[driven]) for of in lanes)
    size = HUMAN.acceleration_rms_mps2 * (SIMULATED[1] / SIMULATED[0]) ** ((wanted - low) / (high - low))
    known = np.isfinite(size[1:]).any(axis=0)
    interval = np.full((2, *known.shape), np.nan)
    interval[:, known] = np.nanpercentile(size[1:][:, known], [2.5, 97.5], axis=0)
    return [Size(*map(float, each)) for each in zip(size[0], *interval, strict=True)]


def _sums(lanes: Sequence[Sequence[Window]]) -> Array:
    """``(lanes, 1 + ranges, 2)``: instants and the sum of squares of the acceleration, of all speeds and each range."""
    sums = np.zeros((len(lanes), len(SPEEDS_MPS), 2))
    for lane, kept in zip(lanes, sums, strict=True):
        for window in lane:
            of = statistics.acceleration(window)
            kept[[0, 1 + range_of(window)]] += len(of), of @ of
    return sums


def _log_rms(sums: Array) -> Array:
    """``(draws, 1 + ranges)`` of ``(draws, lanes, 1 + ranges, 2)``; NaN where a draw has no window of the range."""
    number, squares = np.moveaxis(sums.sum(axis=1), -1, 0)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.log(squares / number) / 2)


def range_of(window: Window) -> int:
    """Which range of ``SPEEDS_MPS`` the window is in."""
    return int(np.searchsorted(SPEEDS_MPS[1:-1], window.speed.mean(), side="right"))
