"""Does the velocity that the truth states cause its displacement?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array
from trackbench.truth.config.columns import UNITS
from trackbench.truth.recorded.drive import Motion

#: The velocity is compared with the displacement over windows of this length, in which the noise of a position of a
#: few centimetres is below the tolerance, s.
WINDOW = 0.5
#: The largest difference that passes, m/s: the range-rate noise of a good automotive radar.
TOLERANCE_MPS = 0.1
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
    difference: float
    """Median length of the difference of the two velocities, m/s."""
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
    """Compare the velocity of a body with its displacement; None where it is too short.

    Args:
        name: of the body.
        motion: as recorded.
        stated_unit: of the speed.
    """
    edges = _windows(motion.time)
    if len(edges) <= FEWEST:
        return None
    dt = np.diff(motion.time[edges])
    moved = np.stack([np.diff(motion.px[edges]), np.diff(motion.py[edges])]) / dt
    steps = np.diff(motion.time)
    travelled = np.stack(
        [np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * steps)])[edges] for v in (motion.vx, motion.vy)]
    )
    stated = np.diff(travelled, axis=1) / dt
    apart = np.hypot(*(moved - stated))
    usual = float(np.median(apart))
    square = float((stated**2).sum())
    scale = float((moved * stated).sum() / square) if square > 0 else 1.0
    fits = None
    for unit, factor in UNITS["speed"].items():
        if unit != stated_unit and abs(scale * UNITS["speed"][stated_unit] / factor - 1) < NEAR:
            fits = unit
    jumps = int((apart > np.maximum(JUMP_MPS, usual + JUMP * 1.4826 * np.median(np.abs(apart - usual)))).sum())
    middle = 0.5 * (motion.time[edges][1:] + motion.time[edges][:-1])
    return VelocityCheck(name, middle, np.hypot(*stated), np.hypot(*moved), usual, scale, fits, jumps)


def _windows(time: Array) -> Array:
    """Numbers of the rows between which windows of at least the wanted length lie."""
    edges = [0]
    for row, instant in enumerate(time.tolist()):
        if instant - time[edges[-1]] >= WINDOW * (1 - 1e-9):
            edges.append(row)
    return np.array(edges, dtype=np.intp)
