"""Initial states for trackers that start from the truth."""

from __future__ import annotations

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Array, of_runs
from trackbench.models.motion import Kinematics
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.filtered import FilterTracker


def with_initial_states(work: Work, piece: BlockRuns, tracker: FilterTracker) -> FilterTracker:
    """Return the tracker with initial states drawn around the truth, if its tracks start from the truth."""
    scene, runs = work.scenes[piece.scene], piece.runs
    truth = scene.truth
    # The start must not depend on sensors that the tracker does not read.
    sensor_steps = [sensor.steps for sensor in scene.sensors if tracker.advances(sensor.name)]
    if not tracker.starts_from_truth or not sensor_steps:
        return tracker
    instants = np.unique(np.concatenate(sensor_steps))
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
