"""A tracker made ready for a block of runs, with its first states where it starts from the truth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Array, Scan, of_runs
from trackbench.driving.remote import start
from trackbench.driving.steppers import Offline, Stepper
from trackbench.models.motion import Kinematics
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import FilterTracker, SmoothedTracker


def stepper_of(
    work: Work, piece: BlockRuns, entry: FilterConfig | PluginConfig, scans: Iterable[Scan], copies: int = 1
) -> Stepper:
    """A fresh tracker for a block of runs.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        entry: the scenario's.
        scans: what it will be given, which a smoother looks at before.
        copies: how often the block is in the batch.
    """
    prepare = partial(with_initial_states, work, piece, copies=copies)
    if isinstance(entry, FilterConfig) and entry.smoother is not None:
        return Offline(SmoothedTracker(prepare(build(entry))), list(scans))
    batch = copies * len(work.scenes[piece.scene].truth.ids) * len(piece.runs)
    return start(entry, work.folder, batch, prepare, work.isolation, sensors=work.sensors)


def with_initial_states(work: Work, piece: BlockRuns, tracker: FilterTracker, copies: int = 1) -> FilterTracker:
    """The tracker with the engine of the work, given its first states drawn from the truth if that is how it starts.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        tracker: of a batch ``(copies * objects * runs,)``.
        copies: how often the block is in the batch, with the same draws.
    """
    scene, runs = work.scenes[piece.scene], piece.runs
    truth = scene.truth
    tracker = replace(tracker, engine=work.engine_here)
    if not any(sensor.config.latency[1] for sensor in scene.sensors):
        # Nothing comes late, and no past state needs to be kept.
        tracker = replace(tracker, lag_s=0.0)
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
        return np.tile(np.broadcast_to(start, shape).reshape(-1), copies)

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
    return tracker.with_prior(np.tile(times, copies), motion, np.tile(normal, (1, copies)))
