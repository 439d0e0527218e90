"""The scans of a scenario, run by run, as a tracker gets them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

from trackbench.base.types import Scan, Truth, scan_of_run
from trackbench.runner.work import Work, work_of
from trackbench.scenario import Scenario
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import sense_known
from trackbench.truth import LoadedTruth


class RunKey(NamedTuple):
    """One Monte-Carlo run of one scene."""

    scene: int
    """From 0."""
    run: int
    """Within the scene, from 0."""

    @property
    def stem(self) -> str:
        """Of the name of its file, where it has one of its own."""
        return f"scene{self.scene}_run{self.run}"


class RunScans(NamedTuple):
    """All scans of one run."""

    key: RunKey
    fingerprint: str
    """Of all its measurements, as in ``result.json``."""
    scans: list[Scan]
    """In the order in which a tracker gets them: by arrival, then by time, then in the scenario's order of sensors.
    ``measurement`` is ``(m, objects)`` with known identities, else ``(m, D)``."""
    objects: tuple[str, ...] | None
    """The name of each object; None where identities are hidden."""


@dataclass
class ScanSource:
    """What is exported of a scenario.

    Args:
        loaded: the scenario.
        truths: one for each scene.
    """

    loaded: Scenario
    truths: Sequence[LoadedTruth]
    fingerprints: dict[RunKey, str] = field(default_factory=dict)
    """Of the runs that were made so far."""

    @cached_property
    def work(self) -> Work:
        """The scenes with their sensors; no tracker has to be there."""
        config = self.loaded.config.model_copy(update={"trackers": {}})
        return work_of(replace(self.loaded, config=config), self.truths)

    @property
    def hidden(self) -> bool:
        """Whether identities are."""
        return self.loaded.config.sensing.identities == "hidden"

    @property
    def keys(self) -> list[RunKey]:
        """Every run of every scene."""
        return [RunKey(scene, run) for scene in range(len(self.truths)) for run in range(self.work.runs)]

    def truth(self, scene: int) -> Truth:
        """Of a scene: with hidden identities all objects, else the targets."""
        return self.truths[scene].truth

    def truth_runs(self) -> Iterator[tuple[str, Truth, int]]:
        """The stem of a file, the truth and the number of the run, once where motion is the same in every run."""
        for scene, item in enumerate(self.truths):
            runs = item.truth.px.shape[-1]
            for run in range(runs):
                yield f"scene{scene}" if runs == 1 else RunKey(scene, run).stem, item.truth, run

    @property
    def scene_names(self) -> list[str]:
        """What tells each scene from the others, such as ``seed 13``."""
        sources = self.loaded.config.truth.scenes()
        return [source.scene_name or f"scene {number + 1}" for number, source in enumerate(sources)]

    def scans(self, key: RunKey) -> RunScans:
        """The scans of one run, the same whatever else is exported."""
        work, scene, runs = self.work, self.work.scenes[key.scene], range(key.run, key.run + 1)
        noise, objects = work.noise_of(key.scene), None
        if self.hidden:
            hidden = sense_hidden(scene.sensors, work.seed, noise, runs)
            digest, taken = hidden.digests[0], [scan_of_run(scan, 0) for scan in hidden.scans]
        else:
            measurements = sense_known(scene.sensors, work.seed, noise, runs)
            digest, taken, objects = measurements.digests[0], measurements.scans, scene.truth.ids
        arrived = sorted(taken, key=lambda scan: (scan.arrival_time, scan.time))
        self.fingerprints[key] = digest.hex()[:16]
        return RunScans(key, self.fingerprints[key], arrived, objects)

    def runs(self) -> Iterator[RunScans]:
        """The scans of every run."""
        return map(self.scans, self.keys)
