"""What a run consists of: scenes, and the blocks of runs in which they go through the trackers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Array, Indices, RecordedNoise, Truth
from trackbench.driving.faults import TrackFault
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import Engine, EngineName, choose_engine
from trackbench.engine.equations import EngineUsed
from trackbench.engine.machine import unavailable
from trackbench.metrics import BUILT_IN, Metric
from trackbench.metrics.intervals import FEWEST_SCENES
from trackbench.metrics.reference import (
    entry_velocity,
    typical_acceleration,
)
from trackbench.metrics.registry import metrics_for, ranking_path
from trackbench.metrics.traffic import TRACK_METRICS, TrafficScoreOptions
from trackbench.models.sensors import Sensor
from trackbench.results import Failure
from trackbench.runner.filed_tracks import rows_of_files
from trackbench.runner.scene import Scene
from trackbench.scenario import Scenario, ScenarioConfig
from trackbench.scenario.keys import TrackerEntry
from trackbench.sensing.scans import ideal_sensors
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.late import LateScans
from trackbench.truth import LoadedTruth
from trackbench.truth.config.recording import ReferenceTruth
from trackbench.truth.config.traffic import TracksConfig
from trackbench.truth.tracks import TrackRows

#: Objects times runs of the first block of a scene, so that two processes share a small run; and of the largest: the
#: step of an extended Kalman filter takes a third less for each of 8,000 than of 2,000, and no less for each of 16,000.
BATCH_SIZE, LARGEST_BATCH = 2000, 8000
#: Objects times runs of blocks of several scenes that are made at once: enough that a step takes its time for them, and
#: so few that two processes share the scenes of a run.
LARGEST_TOGETHER = 1000
#: Objects times runs times instants of a block in which a smoother keeps what its filter believed: some 100 MB.
LARGEST_SMOOTHED = 250_000


class BlockRuns(NamedTuple):
    """Some runs of one scene."""

    scene: int
    runs: range
    """Numbered within the scene."""


class ReferenceMotion(NamedTuple):
    """Motion that the reference of single objects allows for."""

    acceleration: float
    """Standard deviation, m/s^2 per axis."""
    velocity_sigma: float
    """Standard deviation of the velocity at the start, m/s per axis."""
    as_drawn: bool
    """Whether the acceleration is all that drives the targets, drawn anew at each step of the truth."""


@dataclass(frozen=True)
class Work:
    """Everything that is the same for every block of a run."""

    scenario: str
    seed: int
    runs: int
    """Of each scene."""
    scenes: Sequence[Scene]
    trackers: Mapping[str, TrackerEntry]
    folder: Path | None
    """Where a tracker's module is looked for first."""
    settle: float
    divergence: float
    lost_after: float
    """An object that has been out of view of every sensor for longer is not scored, s."""
    recorded_scene: int
    recorded_run: int
    """Numbered within its scene."""
    reference: ReferenceMotion | None = None
    """Motion that the reference of single objects allows for; None where identities are hidden."""
    min_coverage: float = 0.0
    """A tracker of single objects with a smaller share of the estimates that are due is not ranked."""
    metrics: tuple[Metric, ...] = BUILT_IN
    isolation: Isolation = ISOLATED
    track_score: TrafficScoreOptions | None = None
    """How tracks are scored; None where identities are known."""
    engine: Engine = "numpy"
    """What computes, wherever it can be had."""
    driven_twice: BlockRuns | None = None
    """The block through which plug-ins are driven a second time."""
    filed: Mapping[str, Sequence[TrackRows]] = field(default_factory=dict)
    """By tracker whose tracks were made elsewhere, the rows of its file, or of a file for each scene."""
    keeps_answers: bool = False
    """Whether what the trackers say in every run is kept as the table ``answers``."""
    stretches: int = 0
    """Into how many stretches of time the scores of each scene, a log of one run, are cut; 0: into none."""
    counted_stretches: Sequence[tuple[int, int]] = ()
    """The scene and the number of each stretch that counts."""
    few_scenes_decide: bool = False
    """As of the scenario."""

    def driven(self, name: str) -> FilterConfig | PluginConfig:
        """The entry of a tracker that takes scans."""
        entry = self.trackers[name]
        assert not isinstance(entry, TracksConfig)
        return entry

    @property
    def hidden(self) -> bool:
        """Whether scans do not say of which object a detection is, so that trackers follow several objects."""
        return self.track_score is not None

    @property
    def sensors(self) -> Mapping[str, Sensor]:
        """Of the scenario, by name."""
        return {sensor.name: sensor.config for sensor in self.scenes[0].sensors}

    @property
    def steps(self) -> int:
        """How many steps of single objects all trackers take together."""
        objects_and_scans = (
            len(scene.truth.ids) * sum(len(sensor.steps) for sensor in scene.sensors) for scene in self.scenes
        )
        return self.runs * sum(objects_and_scans) * len(self.trackers)

    @property
    def unpaired(self) -> set[str]:
        """The trackers whose tracks were made elsewhere, and do not say of which scans where noise is simulated."""
        recorded = all(sensor.recorded for scene in self.scenes for sensor in scene.sensors)
        without = {name for name, files in self.filed.items() if any(rows.fingerprint is None for rows in files)}
        return set() if recorded else without

    @property
    def engine_here(self) -> Engine:
        """What computes on this machine, which may be another than that on which the engine was chosen."""
        return "numpy" if self.engine == "numpy" or unavailable() else "fused"

    def engine_of(self, used: EngineUsed | None) -> EngineUsed | None:
        """What computed a built-in tracker on this machine, and why not the engine that was chosen."""
        if used is None or self.engine == self.engine_here:
            return used
        return used._replace(why_numpy=unavailable() or "")

    def pieces(self) -> list[BlockRuns]:
        """The runs in blocks, each of which has twice as many as the one before, up to what a process may hold.

        Where a block begins depends on the scenes alone, not on the number of runs: with more runs all blocks stay but
        the last.
        """
        pieces = []
        for number, scene in enumerate(self.scenes):
            start = block = 0
            largest = LARGEST_BATCH
            if any(isinstance(config, FilterConfig) and config.smoother for config in self.trackers.values()):
                largest = min(largest, LARGEST_SMOOTHED // len(scene.instants()))
            while start < self.runs:
                size = min(BATCH_SIZE * 2**block, largest)
                stop = min(start + max(1, size // max(1, len(scene.truth.ids))), self.runs)
                pieces.append(BlockRuns(number, range(start, stop)))
                start, block = stop, block + 1
        return pieces

    def groups(self, pieces: Sequence[BlockRuns]) -> list[list[BlockRuns]]:
        """Blocks that are made at once: with hidden identities small ones of scenes whose sensors measure at the same
        times, since a built-in tracker's step takes as long for a few runs as for one; else each alone."""
        alike: dict[Hashable, list[BlockRuns]] = {}
        for piece in pieces:
            alike.setdefault(self._measured_at(piece), []).append(piece)
        groups: list[list[BlockRuns]] = []
        for some in alike.values():
            sizes = [len(self.scenes[piece.scene].truth.ids) * len(piece.runs) for piece in some]
            before, total = np.cumsum(sizes) - sizes, max(sum(sizes), 1)
            number = before * ceil(total / LARGEST_TOGETHER) // total
            groups += [[some[i] for i in np.flatnonzero(number == part)] for part in np.unique(number)]
        return groups

    def _measured_at(self, piece: BlockRuns) -> Hashable:
        """Equal of blocks that may be made at once."""
        scene = self.scenes[piece.scene]
        late = any(sensor.config.latency[0] < sensor.config.latency[1] for sensor in scene.sensors)
        recorded = any(sensor.recorded or sensor.detections is not None for sensor in scene.sensors)
        built_in = any(isinstance(entry, FilterConfig) for entry in self.trackers.values())
        if not self.hidden or not built_in or self.stretches or not scene.truth.known or late or recorded:
            return piece
        return tuple(sensor.time.tobytes() for sensor in scene.sensors)

    def number(self, scene: int, run: int) -> int:
        """Of a run among those of all scenes; of a log that is cut, that of its first stretch."""
        return scene * max(self.runs, self.stretches) + run

    def noise_of(self, scene: int) -> str:
        """What the random numbers of a scene are drawn by, beside the seed, the run and the sensor."""
        return self.scenario if scene == 0 else f"{self.scenario}, scene {scene}"

    def failure(self, piece: BlockRuns, fault: TrackFault, run: int | None, **where: Any) -> Failure:
        """That a tracker cannot go on; ``run`` is counted from the first of its block."""
        number = None if run is None else self.number(piece.scene, piece.runs.start + run)
        return Failure(cause=fault.cause, place=fault.place, run=number, **where)

    @property
    def headline(self) -> str:
        """The metric that trackers are ranked by."""
        return ranking_path(BUILT_IN if not self.hidden else TRACK_METRICS.values())

    @property
    def reported_metrics(self) -> list[Metric]:
        """Metrics that a result lists, each with a value or the reason why it has none."""
        if not self.hidden:
            return [*self.metrics]
        return [*TRACK_METRICS.values(), *(metric for metric in self.metrics if "truth" in metric.needs)]

    @property
    def has_truth(self) -> bool:
        """Whether every scene has a truth, which a recording with hidden identities may lack."""
        return all(scene.truth.known for scene in self.scenes)

    @property
    def recorded_noise(self) -> RecordedNoise:
        """That of the truth, root mean square over the scenes."""
        every = np.array([scene.truth.recorded_noise for scene in self.scenes])
        return RecordedNoise(*np.sqrt(np.mean(every**2, axis=0)).tolist())

    @property
    def over_stretches(self) -> bool:
        """Whether intervals rest on stretches of time: of a single run, or of few logs."""
        recorded = self.scenes[0].truth.source.get("source") == "recording"
        return self.runs == 1 and (len(self.scenes) == 1 or (recorded and len(self.scenes) < FEWEST_SCENES))

    @property
    def longest_scene(self) -> Scene:
        """The one with the most instants."""
        return max(self.scenes, key=lambda scene: len(scene.instants()))

    @property
    def longest_time(self) -> Array:
        """``(instants,)`` of that scene, s."""
        return self.longest_scene.truth.time[self.longest_scene.instants()]

    def of_scenes(self, scenes: Collection[int]) -> Work:
        """What the blocks of some scenes need: of the others, no more than how many there are."""
        first = self.scenes[min(scenes)]
        return replace(self, scenes=[each if number in scenes else first for number, each in enumerate(self.scenes)])

    def scored_steps(self, scene: Scene) -> Indices:
        """Return the indices of the truth's steps at which the estimates of trackers are scored."""
        return scene.instants() if not self.hidden else scene.due.steps

    def recorded_in(self, piece: BlockRuns) -> int | None:
        """The number of the recorded run in a block, if it is there."""
        return self.recorded_run - piece.runs.start if self.has_recorded_run(piece) else None

    def has_recorded_run(self, piece: BlockRuns) -> bool:
        """Whether the recorded run is one of these."""
        return piece.scene == self.recorded_scene and self.recorded_run in piece.runs

    @property
    def late_sensors(self) -> list[str]:
        """Those whose scans arrive later than they were taken."""
        return [sensor.name for sensor in self.scenes[0].sensors if sensor.config.latency[1] > 0]

    def prepared(self, late: LateScans, change: Callable[[Any], Any] = lambda tracker: tracker) -> Any:
        """Return a built-in tracker with the engine that computes here; bare where nothing comes late.

        Args:
            late: the tracker as it is built.
            change: what else becomes of the bare tracker.
        """
        tracker = change(replace(late.tracker, engine=self.engine_here))
        return replace(late, tracker=tracker) if self.late_sensors else tracker

    @property
    def scene_of_run(self) -> Indices:
        """``(scenes * runs,)`` number of the scene of each run; each stretch of a log that is cut is one of each."""
        if self.stretches:
            return np.arange(len(self.counted_stretches))
        return np.repeat(np.arange(len(self.scenes)), self.runs)


def work_of(
    loaded: Scenario, truths: Sequence[LoadedTruth], isolation: Isolation = ISOLATED, engine: EngineName = "numpy"
) -> Work:
    """What every block of a run of the scenario needs.

    Args:
        loaded: the scenario.
        truths: one for each scene.
        isolation: how its plug-ins are kept apart.
        engine: what computes.

    Raises:
        InputError: the engine cannot be had.
    """
    scenario = loaded.config
    every, score = [item.truth for item in truths], scenario.score
    hidden = scenario.sensing.identities == "hidden"
    each_measurement = score.each == "measurement"
    work = Work(
        scenario=scenario.name,
        seed=scenario.monte_carlo.seed,
        runs=scenario.monte_carlo.runs,
        scenes=[
            Scene(
                item.truth,
                ideal_sensors(item.truth, scenario.sensors, item.measurements),
                each_measurement,
                score.point,
            )
            for item in truths
        ],
        trackers=scenario.trackers,
        folder=loaded.folder,
        settle=score.settle_s,
        divergence=score.divergence_m,
        lost_after=score.lost_after_s,
        recorded_scene=scenario.recording.scene,
        recorded_run=scenario.recording.run,
        reference=None if hidden else _reference_motion(scenario, every),
        min_coverage=0.0 if hidden else score.min_coverage,
        metrics=(*metrics_for(scenario.properties), *scenario.own_metrics),
        isolation=isolation,
        track_score=TrafficScoreOptions(score.cutoff_m, score.switch_costs_s) if hidden else None,
        stretches=(scenario.truth.stretches or 0) if isinstance(scenario.truth, ReferenceTruth) else 0,
        counted_stretches=scenario.truth.counted_stretches,
        few_scenes_decide=scenario.few_scenes_decide,
    )
    for scene in work.scenes:
        # Where a size is not known, it is said before anything is driven.
        _ = scene.scored
    filed = rows_of_files(work.trackers, every, work.runs, work.folder or Path())
    return replace(work, engine=choose_engine(engine, work.steps), driven_twice=_drawn_block(work), filed=filed)


def _reference_motion(scenario: ScenarioConfig, truths: Sequence[Truth]) -> ReferenceMotion:
    stated, driven = scenario.score.reference, scenario.truth.white_acceleration
    acceleration, velocity = stated.acceleration_sigma_mps2, stated.velocity_sigma_mps
    if acceleration is None:
        acceleration = typical_acceleration(truths) if driven is None else driven
    velocity = entry_velocity(truths) if velocity is None else velocity
    return ReferenceMotion(acceleration, velocity, as_drawn=acceleration == driven)


def _drawn_block(work: Work) -> BlockRuns:
    """The block of a run that is drawn by the seed, so that a block is as likely as it is large."""
    random = stream(work.seed, work.scenario, 0, "block of the second drive")
    number = int(random.integers(work.runs * len(work.scenes)))
    scene, run = divmod(number, work.runs)
    return next(piece for piece in work.pieces() if piece.scene == scene and run in piece.runs)
