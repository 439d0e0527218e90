"""Vans and trucks among vehicles that a simulator makes all alike."""

from __future__ import annotations

from dataclasses import replace

from trackbench.base.streams import stream
from trackbench.truth.config import VehicleSizes
from trackbench.truth.frames import Frames

#: Length and width, m. highway-env's drivers leave 10 m from centre to centre at rest: a longer truck would touch.
VAN, TRUCK = (7.0, 2.0), (10.0, 2.5)


def with_sizes(frames: Frames, shares: VehicleSizes, seed: int) -> Frames:
    """The frames with some bodies the size of vans and trucks; the ego keeps its own.

    Each body's size depends on the seed and its name alone. The motion stays as it was: in highway-env the length is
    also the wheelbase, and drivers look from centre to centre, so that another size would make another drive.
    """
    length, width = frames.length.copy(), frames.width.copy()
    for body, name in enumerate(frames.ids):
        draw = stream(seed, "vehicle sizes", 0, name).random()
        if name != "ego" and draw < shares.truck + shares.van:
            length[body], width[body] = TRUCK if draw < shares.truck else VAN
    return replace(frames, length=length, width=width)
