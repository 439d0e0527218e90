"""Trackers started for a block of runs: with first states where they start from the truth, and plug-ins twice."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Array, Scan, of_runs
from trackbench.driving.again import AskedAgain
from trackbench.driving.isolation import plugged_in
from trackbench.driving.start import start_stepper
from trackbench.driving.steppers import Offline
from trackbench.models.motion import Kinematics
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.answers import is_random
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import FilterTracker, SmoothedTracker

#: Number of runs through which a tracker is driven again that is not batched.
RUNS = 2


def stepper_of(work: Work, piece: BlockRuns, entry: FilterConfig | PluginConfig, scans: Iterable[Scan]) -> Any:
    """A fresh tracker for a block of runs.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        entry: the scenario's.
        scans: what it will be given, which a smoother looks at before.
    """
    with_states = partial(with_initial_states, work, piece)
    if isinstance(entry, FilterConfig) and entry.smoother is not None:
        tracker = replace(build(entry).tracker, engine=work.engine_here)
        return Offline(SmoothedTracker(with_states(tracker)), list(scans))
    batch = len(work.scenes[piece.scene].truth.ids) * len(piece.runs)
    prepare = partial(work.prepared, change=with_states)
    return start_stepper(entry, work.folder, batch, prepare, work.isolation, sensors=work.sensors)


def with_initial_states(work: Work, piece: BlockRuns, tracker: FilterTracker) -> FilterTracker:
    """Return the tracker, given its first states drawn from the truth if that is how it starts.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        tracker: of a batch ``(objects * runs,)``.
    """
    scene, runs = work.scenes[piece.scene], piece.runs
    truth = scene.truth
    # When it starts must not depend on sensors that it does not read.
    own = [sensor.steps for sensor in scene.sensors if tracker.advances(sensor.name)]
    if not tracker.starts_from_truth or not own:
        return tracker
    instants = np.unique(np.concatenate(own))
    objects = np.arange(len(truth.ids))
    first = instants[np.argmax(truth.alive[instants], axis=0)]
    shape = (len(objects), len(runs))

    def at_start(values: Array) -> Array:
        start = of_runs(values[first, objects], runs)
        return np.broadcast_to(start, shape).reshape(-1)

    fields = (truth.px, truth.py, truth.speed, truth.course, truth.acceleration, truth.yaw_rate)
    motion = Kinematics(*(at_start(values) for values in fields))
    size = max(6, *(len(motion.components) for motion in tracker.filter.motions))
    draws = [
        stream(work.seed, work.noise_of(piece.scene), run, "initial state").standard_normal((size, len(objects)))
        for run in runs
    ]
    normal = np.stack(draws, axis=-1).reshape(size, -1)
    when = np.where(truth.alive[instants].any(axis=0), truth.time[first], np.inf)
    times = np.broadcast_to(when[:, None], shape).reshape(-1)
    return tracker.with_prior(times, motion, normal)


def asked_again(work: Work, piece: BlockRuns, config: FilterConfig | PluginConfig, tracker: Any) -> Any:
    """Wrap a plug-in so that it is asked again; return a built-in tracker, or one that draws random numbers, as it is.

    A batched one gets half of the batch, permuted; any other two runs in reverse order.

    Args:
        work: what all blocks share.
        piece: the runs of the block.
        config: the scenario's entry.
        tracker: started for the block.
    """
    if not plugged_in(config) or is_random(tracker):
        return tracker
    # Members are numbered by object, then run; with hidden identities each is a run.
    objects, runs = 1 if work.hidden else len(work.scenes[piece.scene].truth.ids), len(piece.runs)
    random = stream(work.seed, work.noise_of(piece.scene), piece.runs.start, "second drive")
    if tracker.batched:
        order = random.permutation(objects * runs)[objects * runs // 2 :]
    else:
        chosen = np.sort(random.permutation(runs)[:RUNS])
        order = np.concatenate([np.arange(objects) * runs + run for run in chosen])[::-1]
    sensors = work.sensors
    start = partial(start_stepper, config, work.folder, len(order), work.prepared, work.isolation, work.hidden, sensors)
    return AskedAgain(tracker, start, order)
