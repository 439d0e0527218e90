"""The reference of a log: the noise of its rows, and its velocity beside its displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.truth.config.columns import UNITS
from trackbench.truth.recorded import Drive
from trackbench.truth.recorded.drive import Motion
from trackbench.truth.recorded.robust import THIRD, body_sigmas, travelled, white_sigma

#: Variance of the mean square of N third differences of white noise, times N: twice the sum of the squares of their
#: autocorrelation.
_FREEDOM = 2 * float((np.correlate(THIRD, THIRD, "full") ** 2).sum()) / float((THIRD**2).sum()) ** 2


@dataclass(frozen=True)
class ReferenceNoise:
    """Noise of the rows of the reference, independent from row to row."""

    drive: Drive
    objects: tuple[tuple[float, float], ...]
    """Standard deviation of position and velocity of each object, m and m/s."""
    observer: tuple[float, float, float]
    """Standard deviation of position, velocity and heading of what carries the sensors, m, m/s and rad."""
    reach_s: float
    """Derivatives with respect to time are differences over this much to either side."""
    uncertainty: float
    """Standard deviation of the variances of an object, as a share of them."""

    def variance(self, time: Array, owner: Indices) -> Array:
        """``(5, rows)`` of px, py, vx, vy of objects relative to the observer, and of its heading, at some times."""
        variance = np.zeros((5, len(time)))
        for number, (motion, sigmas) in enumerate(zip(self.drive.motions.values(), self.objects, strict=True)):
            own = owner == number
            share = _interpolated(motion.time, time[own])
            for row, sigma in enumerate(np.repeat(sigmas, 2).tolist()):
                variance[row, own] = sigma**2 * share
        if self.drive.observer is not None:
            share = _interpolated(self.drive.observer.time, time)
            position, velocity, heading = self.observer
            variance += np.square([position, position, velocity, velocity, heading])[:, None] * share
        return variance


def reference_noise(drive: Drive) -> ReferenceNoise:
    """The noise of a reference, from its rows."""
    objects = tuple(body_sigmas(motion) for motion in drive.motions.values())
    carried, observer = drive.observer, (0.0, 0.0, 0.0)
    if carried is not None:
        assert carried.heading is not None
        observer = (*body_sigmas(carried), white_sigma(np.unwrap(carried.heading)[None]))
    groups = [list(drive.motions.values()), [carried] if carried is not None else []]
    intervals = [np.concatenate([np.diff(m.time) for m in group]) for group in groups if group]
    usual = max(SHORTEST_S, *(float(np.median(each)) if len(each) else 0.0 for each in intervals))
    noise = max(observer[0], *(position for position, _ in objects)) / (np.sqrt(2) * RATE_NOISE_MPS)
    fewest = max(1, min(len(m.time) for m in drive.motions.values()))
    return ReferenceNoise(
        drive, objects, observer, max(usual, min(noise, LONGEST_S)), float(np.sqrt(_FREEDOM / (2 * fewest)))
    )


#: A derivative with respect to time is a difference over at least one row to either side, and no less than this, for
#: truth that is written to the millimetre; and over so much that the noise of the positions makes no more of the speed,
#: but no longer than a vehicle moves evenly.
SHORTEST_S, RATE_NOISE_MPS, LONGEST_S = 0.01, 0.15, 0.5


def _interpolated(rows: Array, time: Array) -> Array:
    """Variance of a value interpolated linearly between rows of unit variance: one at a row, a half in the middle."""
    if len(rows) < 2:
        return np.ones_like(time)
    after = np.clip(np.searchsorted(rows, time, side="right"), 1, len(rows) - 1)
    between = np.clip((time - rows[after - 1]) / (rows[after] - rows[after - 1]), 0.0, 1.0)
    return np.asarray((1 - between) ** 2 + between**2)


#: The velocity is compared with the displacement over windows of this length, s.
WINDOW = 0.5
#: The largest difference that passes, m/s: the range-rate noise of a good automotive radar.
TOLERANCE_MPS = 0.1
#: As many windows are taken together as bring the difference that the noise of the positions makes below this, m/s. At
#: half of the tolerance the median of few windows still passed it in one of a thousand logs; so in one of 100 000.
NOISE_MPS = 0.4 * TOLERANCE_MPS
#: A scale this near to that of another unit is taken for it.
NEAR = 0.03
#: Windows of motion without which nothing is said of an object.
FEWEST = 4


@dataclass(frozen=True)
class VelocityCheck:
    """The velocity of one body of the truth beside its displacement."""

    name: str
    time: Array
    """``(windows,)`` s, their middles."""
    stated: Array
    """``(windows,)`` speed by the stated velocity, m/s."""
    moved: Array
    """``(windows,)`` speed by the displacement, m/s."""
    noise: float
    """Standard deviation of the noise of the positions, m."""
    difference: float
    """Median length of the difference of the two velocities, m/s, over windows that the noise makes longer."""
    scale: float
    """The displacement's velocity is this many times the stated one."""
    unit: str | None
    """The unit in which the stated speed would fit, if it is another one."""
    jumps: int
    """Windows with a displacement that no vehicle makes, beside the stated velocity."""

    @property
    def contradicts(self) -> bool:
        """Whether the velocity cannot be that of the motion."""
        return self.difference > TOLERANCE_MPS


#: A displacement that differs from the stated velocity by more than this many times its own spread is a jump; and m/s.
JUMP, JUMP_MPS = 10.0, 5.0


def velocity_check(name: str, motion: Motion, stated_unit: str) -> VelocityCheck | None:
    """Compare the velocity of a body with its displacement; None where it is too short."""
    # Rows between which windows of at least the wanted length lie.
    rows = [0]
    for row, instant in enumerate(motion.time.tolist()):
        if instant - motion.time[rows[-1]] >= WINDOW * (1 - 1e-9):
            rows.append(row)
    edges = np.array(rows, dtype=np.intp)
    noise = body_sigmas(motion)[0]
    # The median length of a difference of two positions with this noise, over what it may make of the velocity.
    longest = np.sqrt(2) * np.sqrt(2 * np.log(2)) * noise / NOISE_MPS
    wide = edges[:: max(1, int(np.ceil(longest / WINDOW)))]
    if len(wide) <= FEWEST:
        return None
    position, by_velocity = np.stack([motion.px, motion.py]), travelled(motion)
    dt = np.diff(motion.time[edges])
    moved, stated = (np.diff(place[:, edges], axis=1) / dt for place in (position, by_velocity))
    usual = float(np.median(np.hypot(*np.diff((position - by_velocity)[:, wide], axis=1)) / np.diff(motion.time[wide])))
    square = float((stated**2).sum())
    scale = float((moved * stated).sum() / square) if square > 0 else 1.0
    fits = None
    for unit, factor in UNITS["speed"].items():
        if unit != stated_unit and abs(scale * UNITS["speed"][stated_unit] / factor - 1) < NEAR:
            fits = unit
    apart = np.hypot(*(moved - stated))
    middle = np.median(apart)
    jumps = int((apart > max(JUMP_MPS, middle + JUMP * 1.4826 * np.median(np.abs(apart - middle)))).sum())
    time = 0.5 * (motion.time[edges][1:] + motion.time[edges][:-1])
    return VelocityCheck(name, time, np.hypot(*stated), np.hypot(*moved), noise, usual, scale, fits, jumps)
