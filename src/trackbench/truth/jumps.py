"""Limits of the motion of vehicles, and jumps in it."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from trackbench.base.types import Array, Mask, Truth
from trackbench.results.scenario_summary import VelocityJumps

#: No vehicle on wheels accelerates like this, m/s^2: twice the grip of a tyre, whose coefficient of friction on dry
#: asphalt is 0.8 to 0.9 (Wong, Theory of Ground Vehicles, section 1.3). One grip would also count the cars that a
#: simulator lets round a bend too fast for any tyre, on which nothing jumps.
IMPOSSIBLE_MPS2 = 20.0
#: An estimate is near a jump of its object for so long after it, s.
AFTERMATH_S = 1.0


def velocity_jumps(truth: Truth) -> Mask:
    """``(steps - 1, objects, runs or 1)``: the steps in which the velocity jumps."""
    return np.asarray(_change(truth) > IMPOSSIBLE_MPS2 * np.diff(truth.time)[:, None, None])


def after_jump(truth: Truth) -> Mask:
    """``(steps, objects, runs or 1)``: from the end of a jump of the same object until ``AFTERMATH_S`` later."""
    jumped = velocity_jumps(truth)
    time = truth.time[:, None, None]
    ends = np.where(jumped, time[1:], -np.inf)
    begin = np.full((1, *jumped.shape[1:]), -np.inf)
    latest = np.maximum.accumulate(np.concatenate([begin, ends]), axis=0)
    # Times are rounded.
    return np.asarray(time - latest <= AFTERMATH_S * (1 + 1e-9))


def summarised(truth: Truth) -> VelocityJumps:
    """Their number, the largest, and the peak acceleration."""
    change = _change(truth)
    if not change.size:
        return VelocityJumps(limit_mps2=IMPOSSIBLE_MPS2)
    acceleration = change / np.diff(truth.time)[:, None, None]
    jumped = np.where(velocity_jumps(truth), change, -np.inf)
    step, body, _ = np.unravel_index(np.argmax(jumped), jumped.shape)
    result = bool(np.isfinite(jumped[step, body]).any())
    return VelocityJumps(
        limit_mps2=IMPOSSIBLE_MPS2,
        count=int(np.isfinite(jumped).sum()),
        largest_mps=float(jumped.max()) if result else None,
        object=truth.ids[int(body)] if result else None,
        time_s=float(truth.time[step + 1]) if result else None,
        peak_acceleration_mps2=float(acceleration.max()),
    )


def _change(truth: Truth) -> Array:
    """Change of the velocity vector in each step, ``(steps - 1, objects, runs or 1)`` m/s; zero where it is absent."""
    there = (truth.alive[:-1] & truth.alive[1:])[..., None]
    return np.asarray(np.where(there, np.hypot(np.diff(truth.vx, axis=0), np.diff(truth.vy, axis=0)), 0.0))


#: Least and most that can be meant, by quantity, and its unit.
POSSIBLE = {
    "length": (-1e8, 1e8, " m"),
    "speed": (-1e5, 1e5, " m/s"),
    "angle": (-1e6, 1e6, " rad"),
    "time": (-1e30, 1e30, " s"),
    "size": (0.001, 100.0, " m"),
    "probability": (0.0, 1.0, ""),
}
LARGEST = {quantity: most for quantity, (_, most, _) in POSSIBLE.items()}
#: Of a recording, s.
LONGEST = 86_400.0

Position = Annotated[float, Field(ge=-LARGEST["length"], le=LARGEST["length"])]
Speed = Annotated[float, Field(ge=0, le=LARGEST["speed"])]
Velocity = Annotated[float, Field(ge=-LARGEST["speed"], le=LARGEST["speed"])]


def why_too_long(seconds: float) -> str:
    """What is wrong with a time after the first of a recording."""
    return f"{seconds:.6g} s after the first, and a recording lasts {LONGEST:g} s at most: check the unit of time"
