"""Sound and faulty trackers that the doctor was not made with: other code, other strengths."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi

from . import sort_like, stonesoup_gnn
from .builtin_faults import Changed
from .ipda import Ipda
from .sort_like import SortLike
from .stonesoup_gnn import StoneSoupGnn
from .subject import Make, TrafficSubject, built_in, config, looped


class Misread:
    """A sound tracker that reads a wrong figure of the sensor."""

    def __init__(self, method, clutter=1.0, chance=1.0):
        self.tracker, self.clutter, self.chance = build_multi(config(method)), clutter, chance

    def step(self, state, scan):
        scan = scan._replace(
            clutter_density=self.clutter * scan.clutter_density,
            detection_probability=self.chance * scan.detection_probability,
        )
        return self.tracker.step(state, scan)


class Inverted(Misread):
    """The probability of a miss stands for that of a detection."""

    def step(self, state, scan):
        return self.tracker.step(state, scan._replace(detection_probability=1 - scan.detection_probability))


class PerDegree(Misread):
    """A radar's clutter is taken to be per degree, a lidar's per square kilometre."""

    def step(self, state, scan):
        factor = np.pi / 180 if scan.kind == "radar" else 1e-6
        return self.tracker.step(state, scan._replace(clutter_density=factor * scan.clutter_density))


class Ghosts(Changed):
    """Tracks that ended go on, straight."""

    def step(self, state, scan):
        inner, old = state or (None, {})
        inner, tracks = self.tracker.step(inner, scan)
        now = {one: (scan.time, tracks.mean[:, k], tracks.covariance[..., k]) for k, one in enumerate(tracks.ids)}
        old = {**old, **now}
        means = [[*(m[:2] + (scan.time - t) * m[2:]), *m[2:]] for t, m, _ in old.values()]
        covariances = [P for _, _, P in old.values()]
        shown = (
            np.array(list(old), dtype=int),
            np.array(means).reshape(-1, 4).T,
            np.array(covariances).reshape(-1, 4, 4).transpose(1, 2, 0),
        )
        return (inner, old), shown


class TwoOfThem:
    """Two trackers side by side, and the tracks of both."""

    def __init__(self, method):
        self.trackers = [build_multi(config(method)), build_multi(config(method, sigma=6.0))]

    def step(self, state, scan):
        found = [tracker.step(one, scan) for tracker, one in zip(self.trackers, state or (None, None), strict=True)]
        parts = [tracks._replace(ids=2 * tracks.ids + k) for k, (_, tracks) in enumerate(found)]
        joined = (None if a is None else np.concatenate([a, b], axis=-1) for a, b in zip(*parts, strict=True))
        return [one for one, _ in found], type(parts[0])(*joined)


class ModuloTwelve(Changed):
    def change(self, tracks):
        return tracks._replace(ids=tracks.ids % 12)


class MergesNeighbours(Changed):
    """Of detections nearer than 3 m to each other only the first in the list is kept."""

    def step(self, state, scan):
        z = scan.measurement
        points = np.array([z[0] * np.cos(z[1]), z[0] * np.sin(z[1])]) if scan.kind == "radar" else z
        kept = []
        for j in range(z.shape[1]):
            if all(np.hypot(*(points[:, j] - points[:, i])) > 3 for i in kept):
                kept.append(j)
        state, tracks = self.tracker.step(state, scan._replace(measurement=z[:, kept], valid=scan.valid[kept]))
        return state, tracks._replace(used=None)


class Shy(Changed):
    """Says nothing of empty scans."""

    def step(self, state, scan):
        state, tracks = self.tracker.step(state, scan)
        return state, (tracks if len(scan.valid) else None)


class Eager(Changed):
    """Each detection that no track took is shown too, under an identity of its own."""

    count = 10**6

    def step(self, state, scan):
        state, tracks = self.tracker.step(state, scan)
        free = sorted(set(range(len(scan.valid))) - set(tracks.used.tolist()))
        z = scan.measurement[:, free]
        x, y = (z[0] * np.cos(z[1]), z[0] * np.sin(z[1])) if scan.kind == "radar" else z[:2]
        mean = np.array([x, y, 0 * x, 0 * x])
        ids = self.count + np.arange(len(free))
        self.count += len(free)
        covariance = np.repeat(np.diag([1.0, 1, 100, 100])[..., None], len(free), axis=-1)
        return state, (
            np.concatenate([tracks.ids, ids]),
            np.concatenate([tracks.mean, mean], axis=-1),
            np.concatenate([tracks.covariance, covariance], axis=-1),
        )


def _reading(method: str, **more: Any) -> Make:
    """A built-in tracker that uses one sensor only for a part of its work."""
    given = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3.0, "associate": {"method": method}}
    built = FilterConfig.model_validate({**given, **more})
    return lambda: build_multi(built)


SOUND: dict[str, Make] = {
    "stone soup gnn": looped(StoneSoupGnn),
    "stone soup gnn, wide and lively": looped(StoneSoupGnn, missed_distance=5.0, intensity=15.0, min_points=2),
    "stone soup gnn, 1.4 s": looped(StoneSoupGnn, deleted_after=1.4, min_points=4),
    "sort": looped(SortLike),
    "sort, two hits, age 6": looped(SortLike, min_hits=2, max_age=6),
    "sort, five hits, age 30": looped(SortLike, min_hits=5, max_age=30, max_distance=5.0),
    "pmb, tracks start from radar": _reading("pmb", initial={"from": "first_measurement", "sensors": ["radar"]}),
    "gnn, reads lidar alone": _reading("gnn", sensors=["lidar"]),
    "jpda, reads radar alone": _reading("jpda", sensors=["radar"]),
    "pmb, ckf": built_in("pmb", "ckf", "cv", 4.0),
    "jipda, ukf cv, gate 0.995": built_in("jipda", "ukf", "cv", 2.0, gate=0.995),
    "gnn, ukf, 3 of 4": built_in("gnn", "ukf", "cv", 5.0, confirm=[3, 4]),
    "ipda, short": looped(Ipda, patience=0.3, lifetime=5.0, gate=0.998),
}


def _held_out() -> Iterator[TrafficSubject]:
    for name, make in SOUND.items():
        yield TrafficSubject("", "sound", name, make)
    for kind in ("lidar", "radar"):
        yield TrafficSubject("", "sound", f"sort, {kind} alone", SOUND["sort"], (kind,))
    for fault, variant, options in (
        ("gate_too_small", "one standard deviation", {"missed_distance": 1.0}),
        ("gate_too_large", "fifteen standard deviations", {"missed_distance": 15.0}),
        ("confirms_too_soon", "one point", {"min_points": 1}),
        ("confirms_too_late", "25 points", {"min_points": 25}),
        ("never_deletes", "after 3.6 s", {"deleted_after": 3.6}),
    ):
        yield TrafficSubject(fault, "stone soup gnn", variant, looped(StoneSoupGnn, **options))
    for fault, kind in {
        "double_tracks": stonesoup_gnn.StartsFromAll,
        "ids_reused": stonesoup_gnn.Numbered,
        "empty_scan_not_predicted": stonesoup_gnn.EmptySkipped,
        "never_deletes": stonesoup_gnn.NeverDeleted,
    }.items():
        yield TrafficSubject(fault, "stone soup gnn", kind.__name__, looped(kind))
    for fault, variant, options in (
        ("gate_too_small", "0.7 standard deviations", {"max_distance": 0.7}),
        ("gate_too_large", "50 standard deviations", {"max_distance": 50.0}),
        ("confirms_too_late", "24 hits", {"min_hits": 24}),
        ("never_deletes", "age 70", {"max_age": 70}),
    ):
        yield TrafficSubject(fault, "sort", variant, looped(SortLike, **options))
    for fault, kinds in {
        "order_dependent": (sort_like.InOrderOfBoxes,),
        "never_deletes": (sort_like.AgeNotCounted,),
        "ids_reused": (sort_like.RecycledLabels,),
        "empty_scan_not_predicted": (sort_like.Frozen,),
        "confirms_too_soon": (sort_like.SeenAtOnce,),
        "double_tracks": (sort_like.PairsOfBoxes, sort_like.ForEachSensor),
    }.items():
        for kind in kinds:
            yield TrafficSubject(fault, "sort", kind.__name__, looped(kind))
    for method in ("jipda", "pmb"):
        misread = partial(looped, Misread, method=method)
        for factor in (1 / 4, 3.0, 1000.0):
            yield TrafficSubject("clutter_misstated", f"builtin {method}", f"{factor:g} times", misread(clutter=factor))
        yield TrafficSubject("clutter_misstated", f"builtin {method}", "PerDegree", looped(PerDegree, method=method))
        yield TrafficSubject("pd_misstated", f"builtin {method}", "0.7 times", misread(chance=0.7))
        yield TrafficSubject("pd_misstated", f"builtin {method}", "Inverted", looped(Inverted, method=method))
        yield TrafficSubject("gate_too_small", f"builtin {method}", "0.75", built_in(method, gate=0.75))
    for fault, kind in {
        "never_deletes": Ghosts,
        "double_tracks": TwoOfThem,
        "ids_reused": ModuloTwelve,
        "order_dependent": MergesNeighbours,
        "empty_scan_not_predicted": Shy,
        "confirms_too_soon": Eager,
    }.items():
        for method in ("gnn", "jpda"):
            yield TrafficSubject(fault, f"builtin {method}", kind.__name__, looped(kind, method=method))
    yield TrafficSubject("confirms_too_late", "builtin gnn", "22 of 25", built_in("gnn", confirm=[22, 25]))
    yield TrafficSubject("never_deletes", "builtin jpda", "3.5 s", built_in("jpda", delete_after_s=3.5))
    yield TrafficSubject("order_dependent", "builtin naive", "ukf", built_in("naive", "ukf"))


HELD_OUT: list[TrafficSubject] = list(_held_out())
