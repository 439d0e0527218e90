"""Faults in the probabilistic data association: options, and methods that override its own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .ipda import Ipda
from .subject import TrafficSubject, looped


class AlwaysDetects(Ipda):
    """With the probability ``chance``, whatever the sensor says."""

    chance = 0.99

    def detects(self, scan):
        return self.chance


class SeldomDetects(AlwaysDetects):
    chance = 0.6


class UsualChance(AlwaysDetects):
    chance = 0.9


class ClutterFactor(Ipda):
    factor = 57.3

    def clutter(self, scan):
        return self.factor * scan.clutter_density


class ThirdOfClutter(ClutterFactor):
    factor = 1 / 3


class OwnClutter(Ipda):
    def clutter(self, scan):
        return 1e-4


class OneAfterAnother(Ipda):
    """The first track takes what it likes, the next one what is left."""

    def shares(self, tracks, likely, scan):
        free, share = np.ones(likely.shape[1]), np.zeros_like(likely)
        for k, track in enumerate(tracks):
            weight = self.detects(scan) * track.r * likely[k] * free / self.clutter(scan)
            share[k] = weight / (1 - self.detects(scan) * self.gate * track.r + weight.sum())
            free = np.where(share[k] > 0.5, 0.0, free)
        return share


class BornAnyway(Ipda):
    def starting(self, free):
        return np.arange(len(free))

    def shares(self, tracks, likely, scan):
        return np.array(
            [super(BornAnyway, self).shares([t], own[None], scan)[0] for t, own in zip(tracks, likely, strict=True)]
        ).reshape(likely.shape)

    def distinct(self, tracks):
        return tracks


class Free(Ipda):
    def named(self, issued, tracks):
        used = {track.id for track in tracks}
        return min(set(range(len(used) + 1)) - used)


class NotAhead(Ipda):
    def step(self, state, scan):
        if state is not None and not len(scan.valid):
            return state, self.output(state[2])
        return super().step(state, scan)


class Lasting(Ipda):
    def lasts(self, track, scan):
        return track.id >= 0 or super().lasts(track, scan)


class ShowsAll(Ipda):
    confirm_all = True

    def __init__(self, **options):
        super().__init__(confirm=0.0, **options)


def subjects() -> Iterator[TrafficSubject]:
    for fault, variant, options in (
        ("gate_too_small", "0.1", {"gate": 0.1}),
        ("gate_too_small", "0.5", {"gate": 0.5}),
        ("confirms_too_soon", "existence 0.04", {"confirm": 0.04}),
        ("confirms_too_soon", "born at 0.98", {"born": 0.98}),
    ):
        yield TrafficSubject(fault, "ipda", variant, looped(Ipda, **options))
    for fault, kinds in {
        "pd_misstated": (AlwaysDetects, SeldomDetects, UsualChance),
        "clutter_misstated": (ClutterFactor, ThirdOfClutter, OwnClutter),
        "order_dependent": (OneAfterAnother,),
        "double_tracks": (BornAnyway,),
        "ids_reused": (Free,),
        "empty_scan_not_predicted": (NotAhead,),
        "never_deletes": (Lasting,),
        "confirms_too_soon": (ShowsAll,),
    }.items():
        for kind in kinds:
            yield TrafficSubject(fault, "ipda", kind.__name__, looped(kind))
