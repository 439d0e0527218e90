"""Which of a simulator's bodies are tracked, and which are in the truth."""

from __future__ import annotations

import numpy as np

from trackbench.base.errors import InputError, nearest
from trackbench.base.types import Array, Observer
from trackbench.truth.config import HighwayOptions, IdTargets, NearestTargets
from trackbench.truth.frames import Frames


def target_bodies(config: HighwayOptions, frames: Frames, observer: Observer) -> list[int]:
    """The bodies that are tracked.

    Raises:
        InputError: one of them is not in the scene, or none is.
    """
    bodies = [i for i in range(len(frames.ids)) if i > 0 or config.observer != "ego"]
    if isinstance(config.targets, IdTargets):
        known = {frames.ids[i]: i for i in bodies}
        for name in config.targets.ids:
            if name not in known:
                raise InputError(
                    f"there is no vehicle {name!r} in this scene; {nearest(name, known)}", key="truth.targets.ids"
                )
        bodies = sorted({known[name] for name in config.targets.ids})
    elif isinstance(config.targets, NearestTargets):
        nearest_m = _least_distance(frames, observer)
        bodies.sort(key=lambda i: float(nearest_m[i]))
        bodies = sorted(bodies[: config.targets.nearest])
    if not bodies:
        raise InputError(f"there is no vehicle to track in {config.env} with this configuration", key="truth.targets")
    return bodies


def truth_bodies(config: HighwayOptions, frames: Frames, observer: Observer, targets: list[int]) -> list[int]:
    """The bodies of the truth: the targets, or with hidden identities all that a sensor might reach.

    Raises:
        InputError: there is none.
    """
    limit = config.others_within_m
    if limit is None:
        return targets
    near = _least_distance(frames, observer) <= limit
    named = [] if config.targets == "all" else targets
    bodies = [i for i in range(len(frames.ids)) if i in named or (near[i] and (i > 0 or config.observer != "ego"))]
    if not bodies:
        raise InputError(f"no vehicle comes within {limit:g} m of the observer", key="truth.targets")
    return bodies


def _least_distance(frames: Frames, observer: Observer) -> Array:
    """``(bodies,)`` m, over the time that each is there."""
    distance = np.hypot(frames.px - observer.px[:, None], frames.py - observer.py[:, None])
    return np.asarray(np.nanmin(distance, axis=0))
