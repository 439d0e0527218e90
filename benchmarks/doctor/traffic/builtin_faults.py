"""Faults in the built-in trackers of several objects: their options, and wrappers of them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from trackbench.base.types import Scan, Tracks
from trackbench.trackers.multi import build_multi

from .subject import BOTH, TrafficSubject, built_in, config, looped

METHODS = ("gnn", "jpda", "jipda", "pmb")
COUNTING, EXISTENCE = METHODS[:2], METHODS[2:]


class Changed:
    """A sound tracker whose answers are changed."""

    def __init__(self, method: str) -> None:
        self.tracker = build_multi(config(method)).tracker

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        state, tracks = self.tracker.step(state, scan)
        return state, self.change(tracks)

    def change(self, tracks: Tracks) -> Tracks:
        raise NotImplementedError


class Twice(Changed):
    """Each track again, under an identity of its own."""

    def change(self, tracks: Tracks) -> Tracks:
        both = Tracks(*(None if part is None else np.concatenate([part, part], axis=-1) for part in tracks))  # type: ignore[arg-type]
        return both._replace(ids=np.concatenate([2 * tracks.ids, 2 * tracks.ids + 1]))


class Renumbered(Changed):
    """By their place in the list."""

    def change(self, tracks: Tracks) -> Tracks:
        return tracks._replace(ids=np.arange(len(tracks.ids)))


class Returning(Changed):
    """Returns early at an empty scan."""

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        inner, last = state or (None, None)
        if not len(scan.valid) and last is not None:
            return state, last._replace(used=np.full(len(last.ids), -1))
        inner, tracks = self.tracker.step(inner, scan)
        return (inner, tracks), tracks


class NearestInPlane:
    """Each track of a sound tracker that takes no detection jumps to the nearest one, however far it is."""

    def __init__(self) -> None:
        self.tracker = build_multi(config("gnn")).tracker

    def step(self, state: Any, scan: Scan) -> tuple[Any, Tracks]:
        state, tracks = self.tracker.step(state, scan)
        if len(scan.valid) and len(tracks.ids):
            z = scan.measurement
            x, y = (z[0] * np.cos(z[1]), z[0] * np.sin(z[1])) if scan.kind == "radar" else z[:2]
            nearest = np.argmin(np.hypot(tracks.mean[0][:, None] - x, tracks.mean[1][:, None] - y), axis=1)
            mean, free = tracks.mean.copy(), tracks.used < 0
            mean[:2, free] = np.array([x, y])[:, nearest[free]]
            tracks = tracks._replace(mean=mean, used=np.where(free, nearest, tracks.used))
        return state, tracks


def subjects() -> Iterator[TrafficSubject]:
    for method in METHODS:
        fault = partial(_of, method)
        for gate in (0.3, 0.6):
            yield fault("gate_too_small", f"{gate}", gate=gate)
        for name, kind in (
            ("double_tracks", Twice),
            ("ids_reused", Renumbered),
            ("empty_scan_not_predicted", Returning),
        ):
            yield TrafficSubject(name, f"builtin {method}", kind.__name__, looped(kind, method=method))
    for method in COUNTING:
        fault = partial(_of, method)
        yield fault("confirms_too_soon", "1 of 1", confirm=[1, 1])
        yield fault("confirms_too_late", "30 of 40", confirm=[30, 40])
        yield fault("never_deletes", "1000 s", delete_after_s=1000)
    yield _of("gnn", "confirms_too_soon", "1 of 4", confirm=[1, 4])
    yield _of("gnn", "never_deletes", "5 s", delete_after_s=5)
    for method in EXISTENCE:
        fault = partial(_of, method)
        yield fault("confirms_too_soon", "existence 0.01", report_existence=[0.01, 0.005])
        yield fault("confirms_too_late", "existence 1 - 1e-15", report_existence=[1 - 1e-15, 0.5])
        yield fault(
            "never_deletes", "1000 s", delete_after_s=1000, delete_existence=1e-300, report_existence=[0.95, 1e-300]
        )
        for value in (0.5, 0.999):
            yield fault("pd_misstated", f"{value}", detection_probability=dict.fromkeys(BOTH, value))
    yield _of("naive", "order_dependent", "as listed")
    yield _of("naive", "order_dependent", "as listed, gate 0.99", gate=0.99)
    yield TrafficSubject("gate_too_large", "builtin gnn", "jumps to the nearest", looped(NearestInPlane))


def _of(method: str, fault: str, variant: str, **associate: Any) -> TrafficSubject:
    return TrafficSubject(fault, f"builtin {method}", variant, built_in(method, **associate))
