"""The second drive of each plug-in through one block of a run."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Scan
from trackbench.driving.isolation import plugged_in
from trackbench.driving.remote import start
from trackbench.driving.second_drive import Company, SecondDrive
from trackbench.driving.steppers import Traits
from trackbench.runner.work import BlockRuns, Scene, Work
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import IdealSensor, sense_known
from trackbench.trackers.config import FilterConfig, PluginConfig

PURPOSE = "second drive"
#: Distance and relative velocity of every object in the other scenes, seen from the observer, as a share of those here.
NEARER = 0.8
#: Number of runs through which a tracker is driven again that is not batched.
RUNS = 2


class SecondDrives:
    """Makes the second drives of a block; all plug-ins get the same company.

    Args:
        work: what all blocks share.
        piece: the runs of the block.
    """

    def __init__(self, work: Work, piece: BlockRuns) -> None:
        self._work, self._piece = work, piece
        self._others = cache(self._other_scans)

    def start(self, config: FilterConfig | PluginConfig, traits: Traits) -> SecondDrive | None:
        """That of a tracker, or None of one that is built in or draws random numbers.

        A batched one gets a batch of the same width, half of its members replaced by those of other scenes and all
        permuted. Any other gets two runs in reverse order, after one of another scene.

        Raises:
            TrackFault: its process ended.
        """
        if traits.random or not plugged_in(config):
            return None
        work, runs, several = self._work, len(self._piece.runs), self._work.cutoff is not None
        # Members are numbered by object, then run; with hidden identities each is a run.
        objects = 1 if several else len(work.scenes[self._piece.scene].truth.ids)
        members = objects * runs
        random = stream(work.seed, work.noise_of(self._piece.scene), self._piece.runs.start, PURPOSE)
        if traits.batched:
            replaced, other_runs = members // 2, (runs + 1) // 2
            kept = random.permutation(members)[replaced:]
            strangers = random.permutation(objects * other_runs)[:replaced]
            order = random.permutation(np.concatenate([kept, members + strangers]))
        else:
            other_runs, chosen = 1, np.sort(random.permutation(runs)[:RUNS])
            order = np.concatenate(
                [(np.arange(objects) * runs + run) for run in chosen] + [members + np.arange(objects)]
            )[::-1]
        with_engine = partial(replace, engine=work.engine_here)
        stepper = start(config, work.folder, len(order), with_engine, work.isolation, several, work.sensors)
        company = Company(order, members, self._others(other_runs))
        stepper.restart(company.before())
        return SecondDrive(stepper, company, traits.batched)

    def _other_scans(self, count: int) -> list[Scan]:
        """The scans of some runs of other scenes, at the same instants by the same sensors."""
        work, first = self._work, self._piece.runs.start
        sensors = nearer(work.scenes[self._piece.scene])
        sensed = sense_known if work.cutoff is None else sense_hidden
        noise = f"{work.noise_of(self._piece.scene)}, {PURPOSE}"
        return sensed(sensors, work.seed, noise, range(first, first + count)).scans


def nearer(scene: Scene) -> list[IdealSensor]:
    """The sensors of a scene whose objects are nearer to the observer; recorded measurements stay as they are."""
    truth, observer = scene.truth, scene.truth.observer
    target = np.stack([truth.px, truth.py, truth.vx, truth.vy])
    own = np.stack([observer.px, observer.py, observer.vx, observer.vy])[:, :, None, None]
    moved = own + NEARER * (target - own)
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
