"""Whether the velocities that a file states are those of its positions."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array
from trackbench.truth.config.columns import UNITS
from trackbench.truth.tracks import TrackRows

#: Between rows so far apart, s, of bodies that move so far by their positions or by their velocities, m.
APART_S, FAR_M = (1.0, 2.0), 5.0
FEWEST = 10
#: Ratio of speeds, and angle between directions, rad, from which they are said to differ.
RATIO, ANGLE = 1.5, np.pi / 4
#: Least mean resultant length of the angles: below it they are no one rotation.
ALIKE = 0.7
#: m/s in units that speeds are written in.
SPEEDS = {"km/h": UNITS["speed"]["kmph"], "mph": UNITS["speed"]["mph"], "knots": 1852 / 3600}


def contradicted_velocity(rows: TrackRows) -> str | None:
    """Say how the velocities of a file differ from the motion of its positions; None where they agree.

    Args:
        rows: in any order.
    """
    vx, vy = rows.velocity
    speed = rows.speed if vx is None or vy is None else np.hypot(vx, vy)
    if speed is None or len(rows) < 2:
        return None
    first, last = _pairs(rows)
    moved = np.hypot(rows.px[last] - rows.px[first], rows.py[last] - rows.py[first])
    stated = (speed[first] + speed[last]) / 2 * (rows.time[last] - rows.time[first])
    far = np.maximum(moved, stated) > FAR_M
    if far.sum() < FEWEST:
        return None
    ratio = float(np.median(stated[far]) / max(float(np.median(moved[far])), 1e-9))
    if not 1 / RATIO < ratio < RATIO:
        unit = next((name for name, factor in SPEEDS.items() if abs(ratio * factor - 1) < 0.05), None)
        hint = f"are speeds in {unit}?" if unit else "are x and y degrees?" if ratio > 1e3 else "check the units"
        return f"speeds are {ratio:.3g} times those of the positions: {hint}"
    if vx is None or vy is None:
        return None
    direction = (vx[first] + vx[last]) + 1j * (vy[first] + vy[last])
    shift = (rows.px[last] - rows.px[first]) - 1j * (rows.py[last] - rows.py[first])
    turned = np.exp(1j * np.angle((direction * shift)[far])).mean()
    if abs(turned) > ALIKE and abs(np.angle(turned)) > ANGLE:
        degrees = np.degrees(np.angle(turned))
        where = f"velocities point {degrees:+.0f} degrees from the motion of the positions"
        return f"{where}: another frame, or x and y exchanged?"
    return None


def _pairs(rows: TrackRows) -> tuple[Array, Array]:
    """Numbers of rows of one body that are ``APART_S`` apart."""
    keys = [rows.id, *(column for column in (rows.scene, rows.run) if column is not None)]
    owner = np.unique(np.array(keys, dtype=str), axis=1, return_inverse=True)[1]
    order = np.lexsort((rows.time, owner))
    # Bodies one after the other on one axis of time.
    length = float(np.ptp(rows.time)) + 10.0
    axis = rows.time[order] - rows.time.min() + owner[order] * length
    later = np.searchsorted(axis, axis + APART_S[0])
    has_partner = later < len(axis)
    first, later = np.flatnonzero(has_partner), later[has_partner]
    near = axis[later] - axis[first] <= APART_S[1]
    return order[first[near]], order[later[near]]
