"""Keys of a scenario: truth, sensors and trackers, Monte-Carlo runs, scores and expectations."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Annotated, Any, Literal

from pydantic import Field, Tag

from trackbench.base.config import Config, Name, NonNegative, Positive, Problem, chosen_by
from trackbench.base.config.plugin import Plugin
from trackbench.base.errors import InputError
from trackbench.base.subjects import offered, resolve
from trackbench.metrics import Metric
from trackbench.metrics.registry import METRICS
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.scenario.worlds import World
from trackbench.sensing.scored_point import ScoredPoint
from trackbench.trackers.config import NO_KIND, FilterConfig, PluginConfig, entry_kind
from trackbench.truth import TRUTH_SOURCES, TruthSource
from trackbench.truth.config.traffic import TracksConfig
from trackbench.truth.sources import RecordingTruth

#: Metric by its published name or ``"module:Class"``, or as a mapping with its options.
AnyMetric = Annotated[Metric, Plugin(METRICS, "use", word=True, options="options")]


class MonteCarlo(Config):
    """Monte-Carlo runs: repetitions of each scene with new noise."""

    runs: int = Field(100, ge=1, le=1_000_000, description="Number of runs.")
    seed: int = Field(0, ge=0, le=2**32 - 1, description="Seed of the noise of all runs, with the scenario's name.")


class ReferenceConfig(Config):
    """Cramer-Rao bound of targets that move with white acceleration, with which errors are compared."""

    acceleration_sigma_mps2: Positive | None = Field(
        None,
        description="Standard deviation of the acceleration per axis, m/s^2; the RMS acceleration of the truth unless "
        "given.",
    )
    velocity_sigma_mps: Positive | None = Field(
        None,
        description="Standard deviation of the velocity per axis before the first measurement, m/s; the RMS velocity "
        "of the targets as they enter the scene, and at least 1, unless given.",
    )


class Margin(Config):
    """Largest difference that does not matter: a share of the better value or an absolute part, if that is larger."""

    percent: NonNegative = Field(1, description="Share of the better value, %.")
    position_m: NonNegative = Field(0.005, description="Absolute part for errors in m.")
    velocity_mps: NonNegative = Field(0.02, description="Absolute part for errors in m/s.")
    course_deg: NonNegative = Field(0.05, description="Absolute part for errors in degrees.")


class Score(Config):
    """Choice of the scored errors, and of the bounds and margins to compare them with."""

    settle_s: NonNegative = Field(
        1,
        description="Time after an object's first detection that is left out of the scores, s.",
    )
    each: Literal["instant", "measurement"] = Field(
        "instant",
        description="Estimates that are scored where several sensors measure at one instant. instant: the estimate "
        "after the last measurement. measurement: the estimate after each measurement.",
    )
    point: ScoredPoint = Field(
        "centre",
        description="The point of each body that estimates are compared with: centre; rear, the middle of the rear; or "
        "nearest_face, the middle of the face nearest to the observer. Its velocity is that of the rigid body there.",
    )
    divergence_m: Positive = Field(20, description="A run with a larger position error has diverged, m.")
    lost_after_s: Positive = Field(
        1,
        description="An object that has been out of range or view of every sensor for longer is not scored until it is "
        "detected again and settle_s have passed, s.",
    )
    cutoff_m: Positive = Field(
        5, description="With hidden identities: the cutoff of GOSPA, m. A track within half of it is on an object."
    )
    switch_costs_s: Positive = Field(
        0.5,
        description="With hidden identities: a track switch costs as much in T-GOSPA as missing the object for this "
        "time, s.",
    )
    min_coverage: float = Field(
        0.95,
        ge=0,
        le=1,
        description="Smallest share of the due estimates that a tracker must give; with less it is not ranked, and its "
        "expectations fail.",
    )
    margin: Margin = Field(default_factory=Margin, description="Differences between trackers that do not matter.")
    baseline: str | None = Field(
        None,
        description="Name of the tracker with which every other one is compared: fewer comparisons show smaller "
        "differences. Unless given, every pair is compared; with more than 30 trackers, each one with the best.",
    )
    reference: ReferenceConfig = Field(default_factory=ReferenceConfig, description="Bound to compare errors with.")
    metrics: list[AnyMetric] = Field(
        default_factory=list,
        description='Metrics beside the built-in ones: published names, "module:Class", or `{use, options}`.',
    )

    def problems(self) -> Iterator[Problem]:
        names = [metric.name for metric in self.metrics]
        for index, name in enumerate(names):
            if name in names[:index]:
                yield Problem(("metrics", index), f"a second metric of the name {name}")


class Sensing(Config):
    """Whether measurements are labelled with their objects."""

    identities: Literal["known", "hidden"] = Field(
        "known",
        description="known: each measurement is labelled with its object. hidden: detections have no labels, and their "
        "order means nothing; trackers associate them (`associate`).",
    )


class Expectation(Config):
    """Condition on one metric of one tracker, with exactly one of below, above, is and better_than."""

    tracker: str = Field(description="Name of the tracker.")
    metric: str = Field(description="Dotted path of the metric (`trackbench list metrics` shows them).")
    below: float | None = Field(None, description="The value must be smaller, in the metric's unit.")
    above: float | None = Field(None, description="The value must be larger, in the metric's unit.")
    equals: str | None = Field(None, alias="is", description="The verdict must be this word.")
    better_than: str | None = Field(
        None, description="Name of another tracker, which this one must beat by more than chance explains."
    )
    worlds: list[World] = Field(
        default_factory=list,
        description="The worlds in which it must hold; unless given, the ideal one and the scenario outside of worlds.",
    )

    def holds_in(self, world: World | None) -> bool:
        """Return whether the condition must hold in a world (drivers and sensors), or for None outside all worlds."""
        return world in self.worlds if self.worlds else world in (None, "ideal")

    def problems(self) -> Iterator[Problem]:
        operators = {"below": self.below, "above": self.above, "is": self.equals, "better_than": self.better_than}
        stated = [name for name, value in operators.items() if value is not None]
        if not stated:
            yield Problem((), "no limit is given: add below, above, is or better_than")
        for name in stated[1:]:
            yield Problem((name,), f"an expectation has one limit: write a second one beside {stated[0]}")


class RecordingConfig(Config):
    """Scene and Monte-Carlo run that the Rerun recording shows."""

    scene: int = Field(0, ge=0, description="Number of the scene, from 0.")
    run: int = Field(0, ge=0, description="Number of the Monte-Carlo run within the scene, from 0.")


def _entry_kind(value: Any) -> str | None:
    is_tracks = isinstance(value, dict) and "filter" not in value and value.get("use") == "tracks"
    return "<tracks>" if is_tracks or isinstance(value, TracksConfig) else entry_kind(value)


#: Entry of a tracker in a scenario.
TrackerEntry = FilterConfig | PluginConfig | TracksConfig
AnyEntry = Annotated[
    Annotated[FilterConfig, Tag("<filter>")]
    | Annotated[PluginConfig, Tag("<use>")]
    | Annotated[TracksConfig, Tag("<tracks>")],
    chosen_by(_entry_kind, NO_KIND),
]


class ScenarioKeys(Config):
    """One scene, the sensors that see it, the trackers that follow it, and what is expected of them."""

    name: str = Field(
        pattern=r"^[a-z0-9_-]+$",
        max_length=64,
        description="Name of the result's folder. The noise is drawn by the name and the seed: a copy under another "
        "name has other noise.",
    )
    description: str = Field("", description="What the scenario shows, in one line.")
    truth: Annotated[TruthSource, Plugin(TRUTH_SOURCES, "source")] = Field(
        description="Where the true motion comes from."
    )
    sensors: dict[Name, Annotated[Sensor, Plugin(SENSOR_MODELS, "type")]] = Field(
        default_factory=dict,
        description="The sensors, by name. There may be none if every tracker is `use: tracks`.",
    )
    sensing: Sensing = Field(default_factory=Sensing, description="Known or hidden identities.")
    trackers: dict[Name, AnyEntry] = Field(min_length=1, description="The trackers to compare, by name.")
    monte_carlo: MonteCarlo = Field(default_factory=MonteCarlo, description="Repetition with new noise.")
    score: Score = Field(default_factory=Score, description="How errors are scored.")
    expect: list[Expectation] = Field(
        default_factory=list, description="What must hold; otherwise the exit status is 1."
    )
    recording: RecordingConfig = Field(default_factory=RecordingConfig, description="What the recording shows.")
    worlds: list[World] = Field(
        default_factory=list,
        description="The worlds (`trackbench list worlds`) in which the scenario is run, each with a result of its "
        "own. Default: the scenario as it is written.",
    )
    world: World | None = Field(None, description="The world into which the scenario is changed.")

    def driven(self, name: str) -> FilterConfig | PluginConfig:
        """Return the configuration of a tracker that trackbench runs on scans.

        Raises:
            InputError: another program wrote the tracks.
        """
        entry = self.trackers[name]
        if isinstance(entry, TracksConfig):
            message = "its tracks were made elsewhere, so that it cannot be driven"
            raise InputError(message, key=f"trackers.{name}.use")
        return entry

    @property
    def sensor_kinds(self) -> dict[str, str]:
        """Type of each sensor, such as radar, by name of the sensor."""
        return {name: sensor.type for name, sensor in self.sensors.items()}

    @property
    def hides_targets(self) -> bool:
        """Whether other objects can hide targets from a sensor."""
        return self.sensing.identities == "known" and any(sensor.occlusion for sensor in self.sensors.values())

    @property
    def few_scenes_decide(self) -> bool:
        """Whether one scene in a hundred can decide between two trackers, because simulated vehicles hide others."""
        return self.hides_targets and self.truth.source == "highway-env"

    @property
    def properties(self) -> frozenset[str]:
        """Words that metrics may require: "truth" or "no truth"; "labels" (known identities) or "tracks" (hidden)."""
        truth = self.truth
        has_truth = not (isinstance(truth, RecordingTruth) and truth.without_truth)
        identities = "tracks" if self.sensing.identities == "hidden" else "labels"
        return frozenset({identities, "truth" if has_truth else "no truth"})

    @property
    def own_metrics(self) -> list[Metric]:
        """Metrics that are not built in: of subjects with keys in the scenario, and the user's in ``score.metrics``."""
        of_blocks = [resolve(target)(getattr(self, block)) for block, target in offered("metrics")]
        return [*chain.from_iterable(of_blocks), *self.score.metrics]

    @property
    def full_name(self) -> str:
        """Name of the scenario and of its world (drivers and sensors), if any; also the name of the result's folder."""
        return self.name if self.world is None else f"{self.name}-{self.world}"
