"""Existence probabilities of jipda and pmb"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import ABSENT, DUE, OPTIONAL, Array, FieldOfView, Mask, Scan, Tracks
from trackbench.metrics.intervals import ratio
from trackbench.metrics.traffic import TrackHistory, TruthHistory
from trackbench.metrics.traffic.assignment import nearby
from trackbench.metrics.traffic.run import count_by_clear
from trackbench.models.motion.cv import ConstantVelocity
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi
from trackbench.trackers.multi.management import HIDDEN_S

from .claim import Claim

RUNS, SCANS, DT = 200, 50, 0.2
#: m, m, m/s, m/s^2, s
RANGE, SIGMA, VELOCITY_SIGMA, ACCELERATION_SIGMA, LIFETIME = 100.0, 0.3, 5.0, 1.0, 20.0
FALSE_ALARMS = 10.0
#: Nearer than this to the end of the view nothing is counted, m: behind it a track may be right and is not seen.
RIM = 5.0
#: By how much stated and real may differ.
ROOM = 0.05
#: Equal parts of the range from 0 to 1, and the distance from which on a track is on no object, m.
BINS, CUTOFF = 10, 5.0
#: A bin with fewer tracks of one scan is not looked at.
LEAST = 500


class World(NamedTuple):
    """What is simulated, and what the trackers are told unless they are told something else."""

    objects: float
    detection: float
    visible: float | None
    """Mean time until an object hides, s."""


WORLDS = {
    "6 objects, Pd 0.7": World(6.0, 0.7, None),
    "6 objects, Pd 0.9": World(6.0, 0.9, None),
    "40 objects, Pd 0.9": World(40.0, 0.9, None),
    "6 objects that hide at times, Pd 0.9": World(6.0, 0.9, 10.0),
}


#: Every track, not only those that are sure enough to be reported.
ALL_TRACKS = {"report_existence": [0.01, 1e-4]}
TOLD_WRONG: dict[str, dict[str, Any]] = {
    "Pd 0.95": {"detection_probability": {"lidar": 0.95}},
    "that objects hide at times": {"visible_s": 10.0},
}


class Objects(NamedTuple):
    """Objects that come and go, in many runs."""

    state: Array
    """``(4, SCANS, N, RUNS)``."""
    exists: Mask
    """``(SCANS, N, RUNS)``."""
    shows: Mask
    """``(SCANS, N, RUNS)`` not hidden."""


def claims() -> Iterator[Claim]:
    for (label, world), method in product(WORLDS.items(), ("jipda", "pmb")):
        parts, most = _reliability(_bins(world, method, ALL_TRACKS))
        yield _kept(f"{method}, {label}", parts, most)
    dense = WORLDS["40 objects, Pd 0.9"]
    parts, most = _reliability(_bins(dense, "pmb", {"report_existence": [0.95, 0.5]}))
    yield _kept("pmb, 40 objects, Pd 0.9, reported tracks", parts, most)
    for told, keys in TOLD_WRONG.items():
        parts, most = _reliability(_bins(WORLDS["6 objects, Pd 0.7"], "pmb", ALL_TRACKS | keys))
        what = f"where it stops: pmb, 6 objects, Pd 0.7, told {told}"
        yield Claim(what, parts, f"off by more than {ROOM:g} in some bin", most > ROOM)


def _kept(what: str, parts: str, most: float) -> Claim:
    return Claim(what, parts, f"within {ROOM:g} in each bin, but for ±", most <= ROOM, excess=most - ROOM)


def _reliability(bins: Array) -> tuple[str, float]:
    """By what is stated the share that is real; and by how much the worst bin is off, less its Monte-Carlo error.

    Args:
        bins: ``(3, bins, runs)`` sums of what is stated, tracks that are real and all tracks.
    """
    parts, most = [], 0.0
    for stated, real, number in np.moveaxis(bins, 1, 0):
        if number.sum() < LEAST:
            continue
        off = ratio(real - stated, number)
        assert off.ci95 is not None
        mean, error = stated.sum() / number.sum(), (off.ci95[1] - off.ci95[0]) / 2
        parts.append(f"{mean:.2f}: {mean + off.value:.3f} ± {error:.3f}")
        most = max(most, float(abs(off.value) - error))
    return "stated: real " + "; ".join(parts), most


def _bins(world: World, method: str, keys: dict[str, Any]) -> Array:
    random = np.random.default_rng(1)
    objects = _objects(random, world)
    seen = objects.exists & (np.hypot(*objects.state[:2]) < RANGE)
    associate = {
        "method": method, "undetected": world.objects, "birth_rate_hz": world.objects / LIFETIME,
        "lifetime_s": LIFETIME, "visible_s": world.visible, **keys,
    }  # fmt: skip
    tracker = build_multi(
        FilterConfig.model_validate(
            {
                "filter": "kf", "motion": "cv", "acceleration_sigma_mps2": ACCELERATION_SIGMA,
                "initial": {"from": "first_measurement", "velocity_sigma_mps": VELOCITY_SIGMA}, "associate": associate,
            }
        )
    ).tracker  # fmt: skip
    state, answers = None, []
    for k in range(SCANS):
        detected = seen[k] & objects.shows[k] & (random.random(seen[k].shape) < world.detection)
        state, tracks = tracker.step(state, _scan(random, k, objects.state[:2, k], detected, world.detection))
        answers.append(tracks)
    found = []
    for run in range(RUNS):
        status = np.where(seen[..., run], DUE, np.where(objects.exists[..., run], OPTIONAL, ABSENT)).astype(np.int8)
        truth = TruthHistory(DT * np.arange(SCANS), objects.state[..., run], status)
        found.append(existence_bins(truth, _history(answers, run)))
    return np.stack(found, axis=-1)


def existence_bins(truth: TruthHistory, tracks: TrackHistory) -> Array:
    """``(3, 10)`` what is stated, tracks that are on an object, and all tracks, by the probability that they state.

    Source: Murphy and Winkler (1977), "Reliability of subjective probability forecasts of precipitation and
    temperature".
    """
    counted = count_by_clear(nearby(truth, tracks, CUTOFF))
    real = np.zeros(counted.present.shape, dtype=bool)
    real[counted.matched.instant, counted.matched.column] = True
    assert tracks.existence is not None
    stating = counted.present & np.isfinite(tracks.existence)
    stated = tracks.existence[stating]
    which = np.clip((stated * BINS).astype(np.intp), 0, BINS - 1)
    weights = stated, real[stating].astype(float), np.ones(len(which))
    return np.stack([np.bincount(which, weight, BINS) for weight in weights])


def _objects(random: np.random.Generator, world: World) -> Objects:
    """As many as there are in the steady state, whose births are a Poisson process and whose lifetimes exponential."""
    horizon = SCANS * DT
    first, later = (random.poisson(mean, RUNS) for mean in (world.objects, world.objects * horizon / LIFETIME))
    most = int((first + later).max())
    number = np.arange(most)[:, None]
    start = np.where(number < first, 0.0, random.uniform(0, horizon, (most, RUNS)))
    end = start + random.exponential(LIFETIME, start.shape)
    time = DT * np.arange(SCANS)[:, None, None]
    exists = (number < first + later) & (time >= start) & (time < end)
    motion = ConstantVelocity(acceleration_sigma_mps2=ACCELERATION_SIGMA)
    gain = ACCELERATION_SIGMA * motion.noise_gain(np.zeros(4), DT)
    x = np.concatenate([_uniform(random, start.shape), VELOCITY_SIGMA * random.normal(size=(2, *start.shape))])
    # An object begins visible, as a track does.
    shown = np.ones(start.shape, dtype=bool)
    states, shows = [], []
    for k in range(SCANS):
        states.append(x)
        shows.append(shown)
        after = motion.transition(x, DT) + np.tensordot(gain, random.normal(size=(2, *start.shape)), 1)
        x = np.where(exists[k], after, x)
        if world.visible is not None:
            rate = 1 / world.visible + 1 / HIDDEN_S
            at_last = world.visible / (world.visible + HIDDEN_S)
            shown = random.random(shown.shape) < at_last + (shown - at_last) * np.exp(-rate * DT)
            shown |= ~exists[k]
    return Objects(np.stack(states, axis=1), exists, np.stack(shows))


def _uniform(random: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """``(2, ...)`` positions in view."""
    away, angle = RANGE * np.sqrt(random.random(shape)), random.uniform(-np.pi, np.pi, shape)
    return away * np.array([np.cos(angle), np.sin(angle)])


def _scan(random: np.random.Generator, k: int, place: Array, detected: Mask, probability: float) -> Scan:
    """Positions of the detected objects and false alarms, in each run the detections first."""
    false = random.poisson(FALSE_ALARMS, RUNS)
    noisy = place + SIGMA * random.normal(size=place.shape)
    both = np.concatenate([noisy, _uniform(random, (int(false.max()), RUNS))], axis=1)
    valid = np.concatenate([detected, np.arange(false.max())[:, None] < false])
    order = np.argsort(~valid, axis=0, kind="stable")
    both, valid = np.take_along_axis(both, order[None], axis=1), np.take_along_axis(valid, order, axis=0)
    return Scan(
        k * DT, "lidar", "lidar", np.where(valid, both, np.nan), valid, SIGMA**2 * np.eye(2), np.zeros(3), np.zeros(2),
        k * DT, probability, FALSE_ALARMS / (np.pi * RANGE**2), FieldOfView(np.pi, RANGE),
    )  # fmt: skip


def _history(answers: list[Tracks], run: int) -> TrackHistory:
    """The tracks of one run; those near the rim state no existence."""
    most = max(len(tracks.ids) for tracks in answers)
    ids, existence = np.full((SCANS, most), -1), np.full((SCANS, most), np.nan)
    mean, covariance = np.full((4, SCANS, most), np.nan), np.full((4, 4, SCANS, most), np.nan)
    for k, tracks in enumerate(answers):
        own = slice(len(tracks.ids))
        assert tracks.existence is not None
        ids[k, own], existence[k, own] = tracks.ids[:, run], tracks.existence[:, run]
        mean[:, k, own], covariance[:, :, k, own] = tracks.mean[..., run], tracks.covariance[..., run]
    existence[np.hypot(*mean[:2]) > RANGE - RIM] = np.nan
    return TrackHistory(ids, mean, covariance, existence)
