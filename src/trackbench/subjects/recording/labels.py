"""The names of the vehicles in the wide view, beside each vehicle where they cover no other name and no vehicle."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array
from trackbench.results.columns import Columns

#: Pixels that a name takes: a letter, the room around it, its height, and the gap between its point and its top.
LETTER, AROUND, HEIGHT, GAP = 7.0, 14.0, 22.0, 6.0
#: What it costs to cover a name or a vehicle, over its share; a place other than the usual one costs its number.
NAME, VEHICLE, PLACE = 1.0, 0.3, 0.01


def label_points(
    vehicles: list[Columns], names: list[str], metres_per_pixel: float, above: bool = False
) -> list[Array]:
    """Where the points are under which the names are drawn.

    Args:
        vehicles: the same times of each, with ``px_m``, ``py_m``, ``length_m``, ``width_m`` and ``alive``.
        names: of each.
        metres_per_pixel: of the view.
        above: whether a name stands above its vehicle rather than below it.

    Returns:
        For each vehicle ``(times, 2)`` m, in the fixed frame.
    """
    at = [np.stack([rows["px_m"], rows["py_m"]], axis=1) for rows in vehicles]
    there = [rows["alive"].astype(bool) for rows in vehicles]
    reach = [float(np.nanmax(rows["length_m"], initial=1.0)) / 2 for rows in vehicles]
    placed: list[tuple[Array, Array]] = []
    found = []
    for i, name in enumerate(names):
        half = np.array([LETTER * len(name) + AROUND, HEIGHT]) / 2 * metres_per_pixel
        beside = reach[i] + half[0]
        below = float(np.nanmax(vehicles[i]["width_m"], initial=1.0)) + half[1]
        # The middle of the name, from that of the vehicle: below it, above, right, left, and farther below.
        right, down = (beside, 0.0), (0.0, -below)
        places = np.array([down, (0.0, below), right, (-beside, 0.0), (0.0, -below - 2 * half[1])])
        if above:
            places[:, 1] *= -1
        middle = at[i][None] + places[:, None]
        cost = np.repeat(PLACE * np.arange(len(places))[:, None], len(at[i]), axis=1)
        for other_middle, other_half in placed:
            cost += NAME * _covered(middle, half, other_middle, other_half)
        for k in range(len(names)):
            if k != i:
                size = np.full(2, reach[k] / 2)
                cost += VEHICLE * np.where(there[k], _covered(middle, half, at[k], size), 0.0)
        best = middle[np.argmin(cost, axis=0), np.arange(len(at[i]))]
        placed.append((np.where(there[i][:, None], best, np.inf), half))
        found.append(best + np.array([0.0, half[1] + GAP * metres_per_pixel]))
    return found


def _covered(middle: Array, half: Array, other: Array, other_half: Array) -> Array:
    """The share of a box that another covers."""
    with np.errstate(invalid="ignore"):
        overlap = np.clip(half + other_half - np.abs(middle - other), 0.0, 2 * np.minimum(half, other_half))
    return np.asarray(np.prod(overlap / (2 * half), axis=-1))
