"""Trackers started for a block of runs: with first states where they start from the truth, and plug-ins twice."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Array, Scan, of_runs
from trackbench.driving.again import AskedAgain
from trackbench.driving.isolation import plugged_in
from trackbench.driving.start import start_stepper
from trackbench.driving.steppers import Offline
from trackbench.models.motion import Kinematics
from trackbench.runner.work import BlockRuns, Scene, Work
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import IdealSensor, sense_known
from trackbench.trackers.answers import is_random
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import FilterTracker, SmoothedTracker

PURPOSE = "second drive"
#: Distance and relative velocity of every object in the other scenes, seen from the observer, as a share of those here.
NEARER = 0.8
#: Number of runs through which a tracker is driven again that is not batched.
RUNS = 2


def stepper_of(
    work: Work, piece: BlockRuns, entry: FilterConfig | PluginConfig, scans: Iterable[Scan], copies: int = 1
) -> Any:
    """A fresh tracker for a block of runs.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        entry: the scenario's.
        scans: what it will be given, which a smoother looks at before.
        copies: how often the block is in the batch.
    """
    with_states = partial(with_initial_states, work, piece, copies=copies)
    if isinstance(entry, FilterConfig) and entry.smoother is not None:
        tracker = replace(build(entry).tracker, engine=work.engine_here)
        return Offline(SmoothedTracker(with_states(tracker)), list(scans))
    batch = copies * len(work.scenes[piece.scene].truth.ids) * len(piece.runs)
    prepare = partial(work.prepared, change=with_states)
    return start_stepper(entry, work.folder, batch, prepare, work.isolation, sensors=work.sensors)


def with_initial_states(work: Work, piece: BlockRuns, tracker: FilterTracker, copies: int = 1) -> FilterTracker:
    """Return the tracker, given its first states drawn from the truth if that is how it starts.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        tracker: of a batch ``(copies * objects * runs,)``.
        copies: how often the block is in the batch, with the same draws.
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


class SecondDrives:
    """Makes the second drives of a block; all plug-ins get the same company.

    Args:
        work: what all blocks share.
        piece: the runs of the block.
    """

    def __init__(self, work: Work, piece: BlockRuns) -> None:
        self._work, self._piece = work, piece
        self._others = cache(self._other_scans)

    def around(self, config: FilterConfig | PluginConfig, tracker: Any) -> Any:
        """Wrap a plug-in so that it is asked again; return a built-in tracker as it is.

        A batched one gets a batch of the same width, half of its members replaced by those of other scenes and all
        permuted. Any other gets two runs in reverse order, after one of another scene. One that draws random numbers is
        not asked again.
        """
        if not plugged_in(config) or is_random(tracker):
            return tracker
        work, runs, several = self._work, len(self._piece.runs), self._work.hidden
        # Members are numbered by object, then run; with hidden identities each is a run.
        objects = 1 if several else len(work.scenes[self._piece.scene].truth.ids)
        members = objects * runs
        random = stream(work.seed, work.noise_of(self._piece.scene), self._piece.runs.start, PURPOSE)
        if tracker.batched:
            replaced, other_runs = members // 2, (runs + 1) // 2
            kept = random.permutation(members)[replaced:]
            strangers = random.permutation(objects * other_runs)[:replaced]
            order = random.permutation(np.concatenate([kept, members + strangers]))
        else:
            other_runs, chosen = 1, np.sort(random.permutation(runs)[:RUNS])
            order = np.concatenate(
                [(np.arange(objects) * runs + run) for run in chosen] + [members + np.arange(objects)]
            )[::-1]
        start = partial(self._start, config, len(order))
        return AskedAgain(tracker, start, order, members, self._others(other_runs))

    def _start(self, config: FilterConfig | PluginConfig, batch: int) -> Any:
        work, several = self._work, self._work.hidden
        return start_stepper(config, work.folder, batch, work.prepared, work.isolation, several, work.sensors)

    def _other_scans(self, count: int) -> list[Scan]:
        """The scans of some runs of other scenes, at the same instants by the same sensors."""
        work, first = self._work, self._piece.runs.start
        sensors = nearer(work.scenes[self._piece.scene])
        sensed = sense_known if not work.hidden else sense_hidden
        noise = f"{work.noise_of(self._piece.scene)}, {PURPOSE}"
        return sensed(sensors, work.seed, noise, range(first, first + count)).scans


def nearer(scene: Scene) -> list[IdealSensor]:
    """The sensors of a scene whose objects are nearer to the observer; recorded measurements stay as they are."""
    truth, observer = scene.truth, scene.truth.observer
    own = np.stack([observer.px, observer.py, observer.vx, observer.vy])[:, :, None, None]
    moved = own + NEARER * (truth.state - own)
    return [
        sensor
        if sensor.recorded
        else replace(
            sensor,
            measurement=sensor.config.measure(
                moved[:, sensor.steps], sensor.pose[:, :, None, None], sensor.velocity[:, :, None, None]
            ),
            bodies=sensor.bodies and replace(sensor.bodies, target=moved[:, sensor.steps]),
        )
        for sensor in scene.sensors
    ]
