"""Jumps of velocity, beyond an acceleration of 20 m/s^2, and limits of plausible quantities."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from trackbench.base.types import Array, Mask, Truth
from trackbench.results.scenario_summary import VelocityJumps

#: Acceleration that no wheeled vehicle reaches, m/s^2: twice the grip of a tyre, with a coefficient of friction of 0.8
#: to 0.9 on dry asphalt (Wong, Theory of Ground Vehicles, section 1.3). At one grip, simulated cars that take a bend
#: too fast would count too, although nothing jumps.
IMPOSSIBLE_MPS2 = 20.0
#: Time after a jump of its object for which an estimate counts as near the jump, s.
AFTERMATH_S = 1.0


def velocity_jumps(truth: Truth) -> Mask:
    """Return in which steps an object's velocity changes by over 20 m/s^2, ``(steps - 1, objects, runs or 1)``."""
    return np.asarray(_change(truth) > IMPOSSIBLE_MPS2 * np.diff(truth.time)[:, None, None])


def after_jump(truth: Truth) -> Mask:
    """Return when an object's velocity has jumped within the last second, ``(steps, objects, runs or 1)``."""
    jumped = velocity_jumps(truth)
    time = truth.time[:, None, None]
    ends = np.where(jumped, time[1:], -np.inf)
    begin = np.full((1, *jumped.shape[1:]), -np.inf)
    latest = np.maximum.accumulate(np.concatenate([begin, ends]), axis=0)
    # The factor allows for rounded times.
    return np.asarray(time - latest <= AFTERMATH_S * (1 + 1e-9))


def summarised(truth: Truth) -> VelocityJumps:
    """Return the number of velocity jumps, the largest jump, and the peak acceleration, over all objects."""
    change = _change(truth)
    if not change.size:
        return VelocityJumps(limit_mps2=IMPOSSIBLE_MPS2)
    acceleration = change / np.diff(truth.time)[:, None, None]
    jumped = np.where(velocity_jumps(truth), change, -np.inf)
    step, body, _ = np.unravel_index(np.argmax(jumped), jumped.shape)
    has_jump = bool(np.isfinite(jumped[step, body]).any())
    return VelocityJumps(
        limit_mps2=IMPOSSIBLE_MPS2,
        count=int(np.isfinite(jumped).sum()),
        largest_mps=float(jumped.max()) if has_jump else None,
        object=truth.ids[int(body)] if has_jump else None,
        time_s=float(truth.time[step + 1]) if has_jump else None,
        peak_acceleration_mps2=float(acceleration.max()),
    )


def _change(truth: Truth) -> Array:
    """Return the change of velocity in each step, ``(steps - 1, objects, runs or 1)`` m/s; zero where absent."""
    is_present = (truth.alive[:-1] & truth.alive[1:])[..., None]
    return np.asarray(np.where(is_present, np.hypot(np.diff(truth.vx, axis=0), np.diff(truth.vy, axis=0)), 0.0))


#: Smallest and largest plausible value, and the unit, by quantity.
POSSIBLE = {
    "length": (-1e8, 1e8, " m"),
    "speed": (-1e5, 1e5, " m/s"),
    "angle": (-1e6, 1e6, " rad"),
    "time": (-1e30, 1e30, " s"),
    "size": (0.001, 100.0, " m"),
    "probability": (0.0, 1.0, ""),
}
LARGEST = {quantity: most for quantity, (_, most, _) in POSSIBLE.items()}
#: Longest recording, s.
LONGEST = 86_400.0

Position = Annotated[float, Field(ge=-LARGEST["length"], le=LARGEST["length"])]
Speed = Annotated[float, Field(ge=0, le=LARGEST["speed"])]
Velocity = Annotated[float, Field(ge=-LARGEST["speed"], le=LARGEST["speed"])]


def why_too_long(seconds: float) -> str:
    """Return the error message for a row ``seconds`` after the first of a recording, longer than allowed."""
    return f"{seconds:.6g} s after the first, and a recording lasts {LONGEST:g} s at most: check the unit of time"
