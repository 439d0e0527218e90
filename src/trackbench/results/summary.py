"""The parts of ``result.json``."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, PlainSerializer

from trackbench.results.metric_value import MetricsByPath, MetricValue, Part, flat_metrics, nested_metrics
from trackbench.results.table_check import FALSE_ALARM, NO_OBJECT, OBSERVER, TableLayout
from trackbench.results.truth_audit import TruthAudit
from trackbench.words import counted

SCHEMA_VERSION = 3
#: How a tracker associates that knows the true origin of each detection.
ORACLE = "oracle"

Metrics = Annotated[
    dict[str, MetricValue],
    AfterValidator(MetricsByPath),
    BeforeValidator(lambda value: dict(flat_metrics(value)) if isinstance(value, Mapping) else value),
    PlainSerializer(lambda flat: nested_metrics({path: metric.model_dump() for path, metric in flat.items()})),
]

#: None where a truth was not audited; such a ``Truth`` has an empty mapping.
Audit = Annotated[TruthAudit | None, BeforeValidator(lambda value: value or None)]


class ScenarioSummary(Part):
    """The scenario as it was run."""

    name: str
    description: str
    file: str
    text: str
    overrides: list[str]


class SceneSummary(Part):
    """One of several scenes."""

    name: str
    """What tells it from the others, such as ``seed 13``."""
    objects: list[str]
    duration_s: float
    audit: Audit
    error: dict[str, float]
    """Of each ranked tracker with an estimate in it: the metric that trackers are ranked by, m."""

    @property
    def order(self) -> list[str]:
        """The trackers by their error in this scene, the best first."""
        return sorted(self.error, key=self.error.__getitem__)


class TruthSummary(Part):
    """Where the truth of the recorded run came from and what the audit found; the source's own options stand beside."""

    model_config = ConfigDict(extra="allow")

    source: str
    objects: list[str]
    known: bool = True
    """False where a recording has measurements alone: nothing is ranked then."""
    steps: int
    dt: float | None
    duration_s: float
    audit: Audit
    cached: bool
    scenes: list[SceneSummary] = Field(default_factory=list)
    """All of them, where there are several."""

    @property
    def vehicles(self) -> str:
        """How many there are, or that nobody knows."""
        return counted(len(self.objects), "vehicle") if self.known else "no truth"


class ComponentNoise(Part):
    """Of one component of a measurement."""

    sigma: float
    unit: str
    """"m", "deg" or "m/s"."""


class MountSummary(Part):
    """The pose of a sensor on the observer."""

    x_m: float
    y_m: float
    yaw_deg: float


class SensorSummary(Part):
    """One sensor."""

    kind: str
    dof: int
    """Components of a measurement."""
    noise: dict[str, ComponentNoise]
    """By component, as the sensor states it."""
    fov_deg: float
    max_range_m: float | None
    """None without a limit."""
    mount: MountSummary
    rate_hz: float | None
    """Of recorded measurements one over the median interval between the sensor's scans; None of a single scan."""
    preset: str | None
    detection_rate: float | None
    """Share of the scans with an object in view that gave a measurement of it."""


class ReferenceSummary(Part):
    """What errors are held against: the Cramer-Rao bound of targets that move with white acceleration.

    It also takes for granted that the sensors' noise is as stated and without bias, and that each measurement is known
    to be of its target.
    """

    kind: Literal["bound", "reference"]
    """bound: the targets do move so, and no tracker can be expected to have smaller errors. reference: they move in
    another way, and a tracker can have smaller errors."""
    motion: str
    acceleration_sigma_mps2: float
    """Standard deviation per axis."""
    acceleration_from: Literal["scenario", "truth"]
    """scenario: as it states. truth: that by which the targets were driven, or else the RMS of their acceleration."""
    acceleration_changes: Literal["each truth step", "each measurement"]
    """When it is drawn anew; measurement: of the sensors that the tracker reads."""
    velocity_sigma_mps: float
    """Standard deviation per axis before the first measurement, for trackers that do not start from the truth."""

    @property
    def label(self) -> str:
        """As a legend names it."""
        return "Cramér-Rao bound" if self.kind == "bound" else "reference"

    @property
    def meaning(self) -> str:
        """What it is, in one sentence."""
        white = f"with white acceleration of {self.acceleration_sigma_mps2:.3g} m/s² per axis"
        if self.kind == "bound":
            moving = white if self.acceleration_sigma_mps2 > 0 else "straight and steadily"
            return f"The vehicles move {moving}, and no tracker can be expected to have smaller errors than this bound."
        source = ", the RMS of the true one" if self.acceleration_from == "truth" else ""
        return (
            f"It is the Cramér-Rao bound that would hold if the vehicles moved {white}{source}. They do not: it serves "
            "to compare, and a tracker can be below it."
        )


class OwnMetricSummary(Part):
    """A metric that is not built in."""

    name: str
    unit: str
    meaning: str
    better: Literal["smaller", "larger"] | None
    compared: bool
    """Whether trackers are compared by it, run by run."""
    per_sensor: bool
    options: dict[str, Any] = Field(default_factory=dict)


class MarginSummary(Part):
    """Differences that do not matter: up to the larger of a share of the better value and an absolute part."""

    percent: float
    position_m: float
    velocity_mps: float
    course_deg: float

    def absolute(self, unit: str) -> float:
        """The absolute part of metrics of a unit; 0 where there is none."""
        return {"m": self.position_m, "m/s": self.velocity_mps, "deg": self.course_deg}.get(unit, 0.0)

    def at(self, value: float, unit: str) -> float:
        """The margin where the better of the two values is this one."""
        return max(self.percent / 100 * abs(value), self.absolute(unit))


class ScoreSummary(Part):
    """Which errors count, and what is computed of them beside the built-in metrics."""

    settle_s: float
    divergence_m: float
    lost_after_s: float
    """An object that has been out of view of every sensor for longer is not scored."""
    min_coverage: float
    """A tracker with a smaller share of the estimates that it should give is not ranked."""
    common_share: float | None
    """Share of the estimates that are due which all ranked trackers gave; these alone are scored."""
    from_s: float
    """The first instant at which a sensor looks; trackers are asked and scored from here on."""
    to_s: float
    """The last one."""
    margin: MarginSummary
    cutoff_m: float | None = None
    """Where identities are hidden, the distance from which a track is not on an object."""
    metrics: list[OwnMetricSummary] = Field(default_factory=list)


class Failure(Part):
    """Why and where a tracker could not go on."""

    cause: str
    place: str | None = None
    """File, line and function in the tracker's code, where they are known."""
    step: int
    """Number of the instant, from 0."""
    time_s: float
    sensor: str | None
    run: int | None
    object: str | None

    def __str__(self) -> str:
        place = [] if self.place is None else [self.place]
        place += [f"step {self.step}", f"{self.time_s:.2f} s"]
        named = {"sensor": self.sensor, "run": self.run, "object": self.object}
        place += [f"{what} {found}" for what, found in named.items() if found is not None]
        return f"{self.cause} ({', '.join(place)})"


class Health(Part):
    """What went wrong without ending the run; None where the tracker failed before it could be counted."""

    diverged_runs: int | None = None
    repaired_covariances: int | None = None
    repaired_runs: int | None = None
    non_finite_estimates: int = 0
    reused_ids: int | None = None
    """Identities that were used again after their track had ended; None where identities are known."""


class ConditionScores(Part):
    """Scores of the estimates under one condition."""

    count: int
    runs: int
    position_rmse: MetricValue | None = None
    velocity_rmse: MetricValue | None = None
    nees: MetricValue | None = None
    nees_position: MetricValue | None = None
    nees_velocity: MetricValue | None = None
    from_m: float | None = None
    """Of a range band."""
    to_m: float | None = None


class Breakdown(Part):
    """Scores by condition; what did not occur is left out."""

    all: ConditionScores
    manoeuvre: dict[str, ConditionScores]
    range: dict[str, ConditionScores]
    age: dict[str, ConditionScores]
    """By time since a sensor could first see the object."""
    jump: dict[str, ConditionScores]
    """By whether the velocity of the truth jumped within the second before."""


class TrackerResult(Part):
    """What one tracker reached. Its metrics are attributes: ``tracker.position_rmse.value``."""

    name: str
    describe: str
    association: str | None = None
    """How a built-in tracker of several objects associates; None of any other."""
    smoother: str | None = None
    """Of a built-in filter whose estimates are made of all measurements of the run; None of any other tracker."""
    failed: Failure | None
    metrics: Metrics
    """By dotted path, such as ``position_rmse``, ``rmse.px`` or ``nis.front_radar``."""
    health: Health
    breakdown: Breakdown | None = None
    scene_share: float | None = None
    """Share of the variance of one run's squared position error that is between scenes; the rest is noise."""

    @property
    def aside(self) -> str:
        """In a word, why it is no competitor: it knows what no tracker knows. Empty of one that is a competitor."""
        if self.smoother is not None:
            return "offline"
        return "reference" if self.association == ORACLE else ""

    @property
    def is_reference(self) -> bool:
        """Whether it is no competitor."""
        return bool(self.aside)

    def __getattr__(self, name: str) -> MetricValue:
        metrics = self.__dict__.get("metrics", {})
        if name in metrics:
            return metrics[name]  # type: ignore[no-any-return]
        raise AttributeError(f"{type(self).__name__!r} object has no attribute or metric {name!r}")

    def of_sensors(self, metric: str) -> dict[str, MetricValue]:
        """A metric that each sensor has, such as ``nis``, by the sensor's name."""
        prefix = f"{metric}."
        return {path.removeprefix(prefix): entry for path, entry in self.metrics.items() if path.startswith(prefix)}


class Difference(Part):
    """The value of one tracker minus that of another, paired over the runs."""

    a: str
    b: str
    metric: str
    unit: str
    value: float
    ci95: tuple[float, float] | None
    margin: float
    """Up to this a difference does not matter."""
    p_value: float
    """Of the hypothesis that the difference is within the margin, corrected for the number of differences of the
    metric."""
    better: str | None
    """The tracker that is shown to be better by more than the margin."""
    verdict: str
    """The same in words."""


class ExpectationResult(Part):
    """What the scenario expects, and what was found."""

    tracker: str
    metric: str
    operator: str
    limit: float | str
    value: float | str | None
    passed: bool
    text: str


class PrecisionReached(Part):
    """How well the leading difference is known, where the number of runs was left to it."""

    target: float
    half_width: float | None
    reached: bool
    max_runs: int
    best: str | None
    second: str | None


class Summary(Part):
    """``result.json``"""

    schema_version: int = SCHEMA_VERSION
    scenario: ScenarioSummary
    seed: int
    runs: int = Field(ge=1)
    """Of all scenes together."""
    versions: dict[str, str]
    engine: str = "numpy"
    command: str
    identities: Literal["known", "hidden"] = "known"
    """hidden: scans do not say of which objects they are, and the result is one of tracks."""
    fingerprints: list[str]
    """One a run, of all its measurements: equal fingerprints mean equal measurements."""
    truth: TruthSummary
    sensors: dict[str, SensorSummary]
    reference: ReferenceSummary | None
    """None where identities are hidden."""
    score: ScoreSummary
    recorded_run: int
    trackers: list[TrackerResult]
    ranking: list[str]
    differences: list[Difference]
    expectations: list[ExpectationResult]
    passed: bool
    artifacts: dict[str, str]
    precision: PrecisionReached | None = None

    @property
    def layout(self) -> TableLayout:
        """What the tables hold."""
        hidden, objects = self.identities == "hidden", [*self.truth.objects, OBSERVER]
        if hidden:
            objects += [*(name for scene in self.truth.scenes for name in scene.objects), FALSE_ALARM, NO_OBJECT]
        names = {
            "tracker": [tracker.name for tracker in self.trackers],
            "sensor": list(self.sensors),
            "object": objects,
            "other_object": objects,
            "role": ["target", OBSERVER],
        }
        return TableLayout(names, self.truth.objects, hidden)

    @property
    def held_against(self) -> ReferenceSummary:
        """The reference of a result whose identities are known."""
        assert self.reference is not None
        return self.reference

    @property
    def headline(self) -> str:
        """The metric that trackers are ranked by; without a truth, by nothing, and this one stands first."""
        if not self.truth.known:
            return "track_count"
        return "position_rmse" if self.identities == "known" else "gospa"

    @property
    def headline_name(self) -> str:
        """In words."""
        return "position RMSE" if self.identities == "known" else "GOSPA"

    @property
    def fingerprint(self) -> str:
        """Of the measurements of all runs together."""
        return hashlib.sha256(" ".join(self.fingerprints).encode()).hexdigest()[:16]
