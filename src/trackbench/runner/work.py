"""Work of a run: its scenes and trackers, and the blocks into which its Monte-Carlo runs are cut."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Array, Indices, RecordedNoise, Truth
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import Engine, EngineName, choose_engine
from trackbench.engine.machine import unavailable
from trackbench.metrics import BUILT_IN, Metric
from trackbench.metrics.intervals import FEWEST_SCENES
from trackbench.metrics.reference import (
    ConditionalBound,
    Information,
    entry_velocity,
    information,
    typical_acceleration,
)
from trackbench.metrics.registry import metrics_for, ranking_path
from trackbench.metrics.traffic import TRACK_METRICS, TrafficScoreOptions
from trackbench.models.sensors import Sensor
from trackbench.runner.external_tracks import rows_of_files
from trackbench.scenario import Scenario, ScenarioConfig
from trackbench.scenario.keys import TrackerEntry
from trackbench.sensing.due import Due, find_due
from trackbench.sensing.scans import IdealSensor, ideal_sensors
from trackbench.sensing.scored_point import ScoredPoint, truth_of_point
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.late import LateScans
from trackbench.truth import LoadedTruth
from trackbench.truth.config.recording import ReferenceTruth
from trackbench.truth.config.traffic import TracksConfig
from trackbench.truth.tracks import TrackRows

#: Members (objects times runs) of the first and of the largest block of a scene. The first is small, so that two
#: processes can share a small run. An extended Kalman filter takes a third less time per member with 8,000 members than
#: with 2,000, and no less with 16,000.
BATCH_SIZE, LARGEST_BATCH = 2000, 8000
#: Members of a group of blocks of several scenes: enough that the time of a step depends on them, and few enough that
#: two processes share the scenes of a run.
LARGEST_TOGETHER = 1000
#: Members times instants of a block with a smoother, which keeps the filter's beliefs: some 100 MB.
LARGEST_SMOOTHED = 250_000


@dataclass(frozen=True)
class Scene:
    """One ground truth with the noise-free measurements of its sensors."""

    truth: Truth
    sensors: list[IdealSensor]
    each_measurement: bool = False
    """Whether trackers are scored after each scan, and not once for all scans of one instant."""
    point: ScoredPoint = "centre"
    """Point of each body that estimates are compared with."""

    @cached_property
    def scored(self) -> Truth:
        """True motion of the scored point of each body."""
        return truth_of_point(self.truth, self.point)

    def instants(self) -> Indices:
        """Return the indices of the truth's steps at which trackers are scored: all steps with a measurement."""
        if not self.sensors:
            return np.arange(len(self.truth.time))
        steps = np.sort(np.concatenate([sensor.steps for sensor in self.sensors]))
        return steps if self.each_measurement else np.unique(steps)

    @cached_property
    def information(self) -> dict[str, Information]:
        """Fisher information on the targets in each sensor's measurements, by sensor."""
        return {sensor.name: information(sensor, self.truth) for sensor in self.sensors}

    @cached_property
    def bounds(self) -> dict[Hashable, ConditionalBound]:
        """Cache of Cramér-Rao bounds, by the sensors that a tracker reads and how its tracks start."""
        return {}

    @property
    def unlabelled(self) -> list[str]:
        """Names of the sensors with recorded detections that are not labelled with objects."""
        return [sensor.name for sensor in self.sensors if sensor.detections is not None]

    @cached_property
    def due(self) -> Due:
        """Which objects must be tracked, may be tracked or are absent at each instant, with hidden identities."""
        return find_due(self.truth, self.sensors)


class BlockRuns(NamedTuple):
    """Block of runs: a range of the runs of one scene, simulated and tracked as one unit."""

    scene: int
    runs: range
    """Numbers of the runs within the scene."""


class ReferenceMotion(NamedTuple):
    """White acceleration that the Cramér-Rao bound assumes for the objects."""

    acceleration: float
    """Standard deviation of the acceleration, m/s^2 per axis."""
    velocity_sigma: float
    """Standard deviation of an object's velocity at its start, m/s per axis."""
    as_drawn: bool
    """Whether the objects really move by this white acceleration alone, drawn at each step of the truth."""


@dataclass(frozen=True)
class Work:
    """Data that all blocks of Monte-Carlo runs share, such as scenes, trackers, rules of scoring and the engine."""

    scenario: str
    seed: int
    runs: int
    """Number of runs of each scene."""
    scenes: Sequence[Scene]
    trackers: Mapping[str, TrackerEntry]
    folder: Path | None
    """Folder that is searched first for modules of trackers; None for no such folder."""
    settle: float
    """Time after an object's first detection that is not scored, s."""
    divergence: float
    """Position error above which a run has diverged, m."""
    lost_after: float
    """Longest time out of view of all sensors at which an object is still scored, s."""
    recorded_scene: int
    recorded_run: int
    """Number, within its scene, of the recorded run: the run that is kept for plots."""
    reference: ReferenceMotion | None = None
    """White acceleration that the Cramér-Rao bound assumes; None with hidden identities."""
    min_coverage: float = 0.0
    """Least share of the due estimates that a single-object tracker must give to be ranked."""
    metrics: tuple[Metric, ...] = BUILT_IN
    isolation: Isolation = ISOLATED
    track_score: TrafficScoreOptions | None = None
    """Criteria by which tracks are scored; None with known identities."""
    engine: Engine = "numpy"
    """Engine that the user chose; a machine that lacks it uses NumPy."""
    driven_twice: BlockRuns | None = None
    """Block of runs in which plug-ins are driven a second time, to check them; None without a second drive."""
    external_tracks: Mapping[str, Sequence[TrackRows]] = field(default_factory=dict)
    """Tracks that other programs wrote, by name of the tracker: rows of one file for all scenes, or of one file per
    scene."""
    keeps_answers: bool = False
    """Whether the trackers' answers in every run are kept as the table ``answers``."""
    stretches: int = 0
    """Number of stretches of time into which each scene, a log of one run, is cut for its scores; 0 for no cut."""
    counted_stretches: Sequence[tuple[int, int]] = ()
    """Number of the scene and number of the stretch, for each stretch that is scored."""
    few_scenes_decide: bool = False
    """Whether vehicles hide others, so that one scene in a hundred can turn which of two trackers is better."""

    def driven(self, name: str) -> FilterConfig | PluginConfig:
        """Return the settings of a tracker that the bench feeds with scans, unlike tracks from a file."""
        entry = self.trackers[name]
        assert not isinstance(entry, TracksConfig)
        return entry

    @property
    def hidden(self) -> bool:
        """Whether identities are hidden: trackers get unlabelled detections of several objects."""
        return self.track_score is not None

    @property
    def sensors(self) -> Mapping[str, Sensor]:
        """Options of each sensor in the scenario, by name of the sensor."""
        return {sensor.name: sensor.config for sensor in self.scenes[0].sensors}

    @property
    def steps(self) -> int:
        """Number of steps of single objects that all trackers take together."""
        objects_and_scans = (
            len(scene.truth.ids) * sum(len(sensor.steps) for sensor in scene.sensors) for scene in self.scenes
        )
        return self.runs * sum(objects_and_scans) * len(self.trackers)

    @property
    def unpaired(self) -> set[str]:
        """Names of trackers of other programs whose tracks do not state from which simulated scans they were made."""
        recorded = all(sensor.recorded for scene in self.scenes for sensor in scene.sensors)
        tracks = self.external_tracks.items()
        return set() if recorded else {name for name, files in tracks if any(r.fingerprint is None for r in files)}

    @property
    def engine_here(self) -> Engine:
        """Engine used on this machine: the chosen one, or NumPy where that one is missing."""
        return "numpy" if self.engine == "numpy" or unavailable() else "fused"

    def pieces(self) -> list[BlockRuns]:
        """Cut the runs into blocks, each with twice as many runs as the block before it, up to a largest size.

        Where a block begins depends on the scenes alone: with more runs only the last block changes.
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
        """Group the blocks of runs that are simulated and tracked together.

        Small blocks share a group if identities are hidden and the sensors of their scenes measure at the same times. A
        built-in tracker's step takes as long for a few runs as for one. Any other block is a group of its own.
        """
        alike: dict[Hashable, list[BlockRuns]] = {}
        for piece in pieces:
            alike.setdefault(self._group_key(piece), []).append(piece)
        groups: list[list[BlockRuns]] = []
        for similar in alike.values():
            sizes = [len(self.scenes[piece.scene].truth.ids) * len(piece.runs) for piece in similar]
            before, total = np.cumsum(sizes) - sizes, max(sum(sizes), 1)
            number = before * ceil(total / LARGEST_TOGETHER) // total
            groups += [[similar[i] for i in np.flatnonzero(number == part)] for part in np.unique(number)]
        return groups

    def _group_key(self, piece: BlockRuns) -> Hashable:
        scene = self.scenes[piece.scene]
        late = any(sensor.config.latency[0] < sensor.config.latency[1] for sensor in scene.sensors)
        recorded = any(sensor.recorded or sensor.detections is not None for sensor in scene.sensors)
        built_in = any(isinstance(entry, FilterConfig) for entry in self.trackers.values())
        if not self.hidden or not built_in or self.stretches or not scene.truth.known or late or recorded:
            return piece
        return tuple(sensor.time.tobytes() for sensor in scene.sensors)

    def number(self, scene: int, run: int) -> int:
        """Return a run's number among the runs of all scenes.

        A log that is cut into stretches has one run; its number is that of the log's first stretch.
        """
        return scene * max(self.runs, self.stretches) + run

    def noise_of(self, scene: int) -> str:
        """Return the text by which a scene's random numbers are seeded, beside seed, run and sensor."""
        return self.scenario if scene == 0 else f"{self.scenario}, scene {scene}"

    @property
    def headline(self) -> str:
        """Name of the metric by which trackers are ranked."""
        return ranking_path(BUILT_IN if not self.hidden else TRACK_METRICS.values())

    @property
    def reported_metrics(self) -> list[Metric]:
        """Metrics that a result lists, each with a value or with the reason for a missing one."""
        if not self.hidden:
            return [*self.metrics]
        return [*TRACK_METRICS.values(), *(metric for metric in self.metrics if "truth" in metric.needs)]

    @property
    def has_truth(self) -> bool:
        """Whether every scene has a truth; a recording with hidden identities may have none."""
        return all(scene.truth.known for scene in self.scenes)

    @property
    def recorded_noise(self) -> RecordedNoise:
        """Noise of a recorded truth, root mean square over the scenes."""
        noise = np.array([scene.truth.recorded_noise for scene in self.scenes])
        return RecordedNoise(*np.sqrt(np.mean(noise**2, axis=0)).tolist())

    @property
    def over_stretches(self) -> bool:
        """Whether intervals are taken over stretches of time: for a single run, or for few logs."""
        recorded = self.scenes[0].truth.source.get("source") == "recording"
        return self.runs == 1 and (len(self.scenes) == 1 or (recorded and len(self.scenes) < FEWEST_SCENES))

    @property
    def longest_time(self) -> Array:
        """``(instants,)`` times at which trackers are scored, s, in the scene that has the most such instants."""
        return max((scene.truth.time[scene.instants()] for scene in self.scenes), key=len)

    def of_scenes(self, scenes: Collection[int]) -> Work:
        """Return the work restricted to ``scenes``; the first of these also replaces every other scene."""
        first = self.scenes[min(scenes)]
        return replace(self, scenes=[each if number in scenes else first for number, each in enumerate(self.scenes)])

    def recorded_in(self, piece: BlockRuns) -> int | None:
        """Return the index within a block of the recorded run (kept for plots); None if it is in another block."""
        is_here = piece.scene == self.recorded_scene and self.recorded_run in piece.runs
        return self.recorded_run - piece.runs.start if is_here else None

    @property
    def late_sensors(self) -> list[str]:
        """Names of the sensors whose scans may arrive later than they were taken."""
        return [sensor.name for sensor in self.scenes[0].sensors if sensor.config.latency[1] > 0]

    def prepare_tracker(self, late: LateScans, change: Callable[[Any], Any] = lambda tracker: tracker) -> Any:
        """Return a built-in tracker with this machine's engine, wrapped for late scans only if a sensor has a latency.

        Args:
            late: tracker with its handling of late scans.
            change: further change of the tracker itself.
        """
        tracker = change(replace(late.tracker, engine=self.engine_here))
        return replace(late, tracker=tracker) if self.late_sensors else tracker

    @property
    def scene_of_run(self) -> Indices:
        """``(scenes * runs,)`` number of each run's scene; each stretch of a cut log counts as a scene of one run."""
        if self.stretches:
            return np.arange(len(self.counted_stretches))
        return np.repeat(np.arange(len(self.scenes)), self.runs)


def work_of(
    loaded: Scenario, truths: Sequence[LoadedTruth], isolation: Isolation = ISOLATED, engine: EngineName = "numpy"
) -> Work:
    """Return the data that all blocks of a scenario's run share.

    Args:
        loaded: the scenario.
        truths: truth of each scene.
        isolation: limits of the processes in which plug-ins run.
        engine: engine that computes built-in trackers and scores.

    Raises:
        InputError: the engine is not available, or a size that the scored point needs is unknown.
    """
    scenario = loaded.config
    scene_truths, score = [item.truth for item in truths], scenario.score
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
        reference=None if hidden else _reference_motion(scenario, scene_truths),
        min_coverage=0.0 if hidden else score.min_coverage,
        metrics=(*metrics_for(scenario.properties), *scenario.own_metrics),
        isolation=isolation,
        track_score=TrafficScoreOptions(score.cutoff_m, score.switch_costs_s) if hidden else None,
        stretches=(scenario.truth.stretches or 0) if isinstance(scenario.truth, ReferenceTruth) else 0,
        counted_stretches=scenario.truth.counted_stretches,
        few_scenes_decide=scenario.few_scenes_decide,
    )
    for scene in work.scenes:
        # An unknown size is reported before any tracker is driven.
        _ = scene.scored
    tracks = rows_of_files(work.trackers, scene_truths, work.runs, work.folder or Path())
    chosen = choose_engine(engine, work.steps)
    return replace(work, engine=chosen, driven_twice=_drawn_block(work), external_tracks=tracks)


def _reference_motion(scenario: ScenarioConfig, truths: Sequence[Truth]) -> ReferenceMotion:
    stated, driven = scenario.score.reference, scenario.truth.white_acceleration
    acceleration, velocity = stated.acceleration_sigma_mps2, stated.velocity_sigma_mps
    if acceleration is None:
        acceleration = typical_acceleration(truths) if driven is None else driven
    velocity = entry_velocity(truths) if velocity is None else velocity
    return ReferenceMotion(acceleration, velocity, as_drawn=acceleration == driven)


def _drawn_block(work: Work) -> BlockRuns:
    """Draw, by the seed, the block for the second drive; a block's probability is in proportion to its runs."""
    random = stream(work.seed, work.scenario, 0, "block of the second drive")
    number = int(random.integers(work.runs * len(work.scenes)))
    scene, run = divmod(number, work.runs)
    return next(piece for piece in work.pieces() if piece.scene == scene and run in piece.runs)
