"""The noise of the rows of a recorded truth, independent from row to row."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trackbench.base.types import Array, RecordedNoise
from trackbench.truth.recorded.drive import Motion
from trackbench.truth.recorded.robust import clipped_sigma

#: Weights of four rows in a third difference, in which neither a place nor a velocity nor an acceleration remains.
THIRD = np.array([1.0, -3.0, 3.0, -1.0])


def white_sigma(values: Array) -> float:
    """Standard deviation of the noise of rows of slow values ``(k, rows)``, by their third differences.

    Source: Rice (1984), "Bandwidth choice for nonparametric regression", with differences of a higher order.
    """
    if values.shape[-1] <= 2 * len(THIRD):
        return 0.0
    differences = np.diff(values, 3).reshape(-1) / np.linalg.norm(THIRD)
    return float(clipped_sigma(differences))


def travelled(motion: Motion) -> Array:
    """``(2, rows)`` displacement since the first row by the stated velocity (trapezoidal rule)."""
    velocity = np.stack([motion.vx, motion.vy])
    steps = 0.5 * (velocity[:, 1:] + velocity[:, :-1]) * np.diff(motion.time)
    return np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)


def body_sigmas(motion: Motion) -> tuple[float, float]:
    """Standard deviation of the noise of position and velocity of a body, m and m/s."""
    position, velocity = np.stack([motion.px, motion.py]), np.stack([motion.vx, motion.vy])
    if len(motion.time) > 1 and np.allclose(velocity, np.gradient(position, motion.time, axis=1)):
        # A velocity that was made of the positions has their noise.
        sigma = white_sigma(position)
        return sigma, sigma / float(np.sqrt(2) * np.median(np.diff(motion.time)))
    # About the motion by the velocity, so that rows may be far apart.
    return white_sigma(position - travelled(motion)), white_sigma(velocity)


def noise_of(motions: Iterable[Motion]) -> RecordedNoise:
    """Standard deviation of position and velocity per axis, root mean square over the rows of all objects."""
    motions = list(motions)
    squares = np.square([body_sigmas(motion) for motion in motions])
    return RecordedNoise(*np.sqrt(np.average(squares, axis=0, weights=[len(m.time) for m in motions])).tolist())
